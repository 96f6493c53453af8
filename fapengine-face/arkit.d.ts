/** Names of ARKit's 52 blend shapes, in the order of Live Link Face. */
export const ARKIT_NAMES: readonly string[];

/** The blend shapes of one face, frame by frame; each frame begins where the one before ended. */
export class ArkitFollower {
  /** @param faps 68 numbers, FAPU. @returns 52 weights, 0..1. */
  follow(faps: ArrayLike<number>): Float64Array;
}

/** A mesh of three.js with morph targets of ARKit's names. */
export interface MorphMesh {
  morphTargetDictionary?: Record<string, number>;
  morphTargetInfluences?: number[];
}

/** A VRM's expressionManager (three-vrm). */
export interface ExpressionManager {
  getExpression(name: string): unknown;
  setValue(name: string, weight: number): void;
}

/** Show FAPs on a rig of one's own. */
export function applyARKit(target: MorphMesh | ExpressionManager, faps: ArrayLike<number>): void;

/** An orientation, rad: positive to the subject's left, down, right ear down. */
export interface Turn {
  yaw: number;
  pitch: number;
  roll: number;
}

/** Turns of head and eyes, which are bones in most rigs. */
export function turns(faps: ArrayLike<number>): { head: Turn; leftEye: Turn; rightEye: Turn };
