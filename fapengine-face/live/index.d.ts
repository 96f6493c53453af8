/** A phone with its times. */
export interface TimedPhone {
  /** IPA; `_` is a silence, which removes what it overlaps. */
  label: string;
  /** s, 0 or later. */
  start: number;
  end: number;
  /** 0 none (default), 1 primary, 2 secondary: the strongest accents nod. In `say` marks of the label, `ˈa`, count as well. */
  stress?: 0 | 1 | 2;
  word?: string;
  /** Relative to the speaker's usual loudness, -12 to 8 dB. */
  loudness?: number;
}

/** A word with its times. */
export interface TimedWord {
  text: string;
  /** s, 0 or later. */
  start: number;
  /** By default the next start, or as long as it takes to say. */
  end?: number | null;
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
  /** Write a frame's 68 FAPs, FAPU; times (s) that go back show the last frame again. */
  frame(time: number, out?: Float32Array, expression?: ArrayLike<number> | null, gestures?: ArrayLike<number> | null): Float32Array;
}

/** FAPs of each frame of a finished list of phones, and its labels that are not IPA. */
export function planAll(
  profile: Profile, phones: TimedPhone[], options?: LiveStyle & { rate?: number },
): { faps: Float32Array[]; unknown: string[] };

/** The small recognizer: sound in, phones out. */
export class Recognizer {
  /** @param buffer Content of `assets/recognizer.bin`. @param options.lookAhead Age at which phones are final, s. */
  constructor(buffer: ArrayBuffer, options?: { lookAhead?: number; steps?: number });
  /** Phones after the final ones, which may still change. */
  readonly partial: TimedPhone[];
  /** @param samples 16 kHz, mono. @returns The phones that are final now, without gaps, silence included. */
  push(samples: Int16Array): TimedPhone[];
  /** End the sound. @returns The rest of its phones. */
  end(): TimedPhone[];
  reset(): void;
}

export interface HearOptions {
  /** By default that of the node; for a stream a new one. */
  context?: AudioContext;
  /** Delay of the face and of the sound that is returned, 0 to 60 s; by default 0.25. */
  delay?: number;
  /** Age at which phones do not change any more, s; by default 0.3. */
  lookAhead?: number;
}

export interface LiveSayOptions {
  /** Position of what is heard now, s. */
  clock?: () => number;
  /** What is said before goes on, with its clock, and a text follows it; by default it ends. */
  add?: boolean;
  /** Phones of a word (IPA), a list or a text with spaces, for languages other than English; `ˈ` and `ˌ` make nods. */
  pronounce?: (word: string, index: number, words: string[]) => Spoken | Promise<Spoken>;
}

export type Spoken = string | string[] | null | undefined;

/** Words that are said. */
export interface SaidWords {
  words: { text: string; start: number; end: number }[];
  /** Those that have no phones. */
  unread: string[];
}

/** Viseme events of Azure's SDK to phones; offsets in ticks of 100 ns. */
export function azurePhones(events: { audioOffset: number; visemeId: number }[]): TimedPhone[];
/** Messages of Cartesia to phones, or, without phones, to words. */
export function cartesiaTimings(messages: object[]): TimedPhone[] | TimedWord[];
/** Alignments of ElevenLabs' characters, in the order of their chunks, to words. */
export function elevenLabsWords(chunks: object[]): TimedWord[];
/** Pieces of LiveKit's timed transcription to words. */
export function liveKitWords(
  pieces: ({ text: string } & ({ startTime: number; endTime?: number } | { start_time: number; end_time?: number }))[],
): TimedWord[];

export interface LiveEventMap {
  started: Event;
  phone: Event & { readonly detail: { label: string; word: string | null; position_s: number } };
  finished: Event;
  cancelled: Event;
  /** The sound's device was unplugged, or its call has ended. */
  lost: Event;
  /** The device that was asked for, or another, is there again. */
  regained: Event;
  /** What is wrong. */
  error: Event & { readonly detail: string };
}

/** A face without a server, DOM or WebGL. */
export class Live extends EventTarget {
  static make(
    options?: LiveStyle & {
      /** No blinks, glances, nods, head motion, drifts and variation. */
      still?: boolean;
      /** Natural variation of speech, 0 to 1 (default). */
      liveliness?: number;
      /** Of these, an integer. */
      seed?: number;
      /** Addresses of the package's files elsewhere. */
      assets?: { planner?: string | URL; recognizer?: string | URL; words?: string | URL; worker?: string | URL; worklet?: string | URL };
    },
  ): Promise<Live>;
  readonly isSpeaking: boolean;
  /**
   * Follow sound; resolves to the delayed sound. Loud speech opens the mouth wider, and stressed vowels nod. Of constraints,
   * `{ audio: true }`, a device is opened, and opened again, or another, where it was unplugged.
   */
  hear(input: MediaStream | AudioNode | MediaStreamConstraints, options?: HearOptions): Promise<AudioNode>;
  /** Follow sound without Web Audio, as it comes. @param samples -1 to 1, mono. @param rate Hz, the same until `stop()`. */
  push(samples: Float32Array, rate: number, options?: { delay?: number; lookAhead?: number }): Promise<void>;
  say(phones: TimedPhone[], options?: LiveSayOptions): void;
  /** A text, or words; resolves to null if something else was begun meanwhile. Stressed vowels nod. */
  say(words: string | TimedWord[], options?: LiveSayOptions): Promise<SaidWords | null>;
  /** @param level 0 to 2. */
  express(name: string, level?: number, fields?: { attack_s?: number; hold_s?: number; release_s?: number }): void;
  /** End what is said. */
  cancel(): void;
  /** Called 60 times a second with 52 ARKit weights and 68 FAPs, where nobody else asks for frames. */
  onweights: ((weights: Float64Array, faps: Float32Array) => void) | null;
  addEventListener<K extends keyof LiveEventMap>(
    type: K, listener: (this: Live, event: LiveEventMap[K]) => unknown, options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string, listener: EventListenerOrEventListenerObject | null, options?: boolean | AddEventListenerOptions,
  ): void;
  /** Write the 68 FAPs of now. @param now The page's clock, s. */
  sample(now: number, faps: Float32Array): { time: number };
  stop(): void;
  close(): void;
}
