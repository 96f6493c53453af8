import type { HTMLAttributes } from "vue";
import type { FapFaceAttributes, FapFaceEventMap } from "./index.js";

export * from "./index.js";

/** Listeners of a template: `@phone="…"` is `onPhone`. */
type Listeners = { [Name in keyof FapFaceEventMap as `on${Capitalize<Name>}`]?: (event: FapFaceEventMap[Name]) => void };

declare module "vue" {
  interface GlobalComponents {
    "fap-face": new () => { $props: Omit<HTMLAttributes, keyof Listeners> & Listeners & FapFaceAttributes };
  }
}
