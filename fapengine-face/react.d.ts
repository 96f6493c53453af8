import type { DetailedHTMLProps, HTMLAttributes } from "react";
import type { FapFace, FapFaceAttributes } from "./index.js";

export * from "./index.js";

declare module "react" {
  namespace JSX {
    interface IntrinsicElements {
      "fap-face": DetailedHTMLProps<HTMLAttributes<FapFace>, FapFace> & FapFaceAttributes;
    }
  }
}
