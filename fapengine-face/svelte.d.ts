import type { HTMLAttributes } from "svelte/elements";
import type { FapFace, FapFaceAttributes, FapFaceEventMap } from "./index.js";

export * from "./index.js";

/** Listeners of a template: `onphone={…}`. */
type Listeners = { [Name in keyof FapFaceEventMap as `on${Name}`]?: (event: FapFaceEventMap[Name]) => void };

declare module "svelte/elements" {
  interface SvelteHTMLElements {
    "fap-face": Omit<HTMLAttributes<FapFace>, keyof Listeners> & Listeners & FapFaceAttributes;
  }
}
