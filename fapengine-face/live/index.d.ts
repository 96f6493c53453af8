/** A phone with its times. */
export interface TimedPhone {
  /** IPA; `_` is a silence, which removes what it overlaps. */
  label: string;
  /** s, 0 or later. */
  start: number;
  end: number;
  word?: string;
  /** Relative to the speaker's usual loudness, -12 to 8 dB. */
  loudness?: number;
}

/** How a face speaks. */
export interface LiveStyle {
  /** Sizes of all movements, of the jaw's and of the lips', 0 to 3; 1 is natural. */
  articulation?: number;
  jaw?: number;
  lips?: number;
  /** -20 to 20 dB; louder speech opens the jaw wider. */
  loudness?: number;
}

/** Tables of a speaker. */
export class Profile {
  /** @param buffer Content of `assets/planner.bin`. */
  constructor(buffer: ArrayBuffer);
}

/** Phones in as they come, FAPs out as they are due; times count from the stream's beginning. */
export class Planner {
  /** @param options.horizon Time after the last frame up to which nothing changes, s; by default 0. */
  constructor(profile: Profile, options?: LiveStyle & { horizon?: number });
  readonly counts: { late: number; dropped: number; revised: number; cancelled: number; unknown: number };
  /** Add phones in any order; each replaces what it overlaps. */
  feed(phones: TimedPhone[]): void;
  /** End speech: the face is neutral `fade` s (by default 0.2) after `at`. */
  cancel(at: number, fade?: number): void;
  /** Write a frame's 68 FAPs, FAPU; times that go back show the last frame again. */
  frame(time: number, out?: Float32Array, expression?: ArrayLike<number> | null): Float32Array;
}

/** FAPs of each frame of a finished list of phones, and its labels that are not IPA. */
export function planAll(
  profile: Profile, phones: TimedPhone[], options?: LiveStyle & { rate?: number },
): { faps: Float32Array[]; unknown: string[] };
