import type { HearOptions, LiveSayOptions, SaidWords, TimedPhone, TimedWord } from "./live/index.js";

/** Values of FAP 1 to 68, FAPU; FAP n is at n - 1. */
export type Faps = Float32Array;

export type Expression =
  "joy" | "sadness" | "anger" | "fear" | "disgust" | "surprise" | "smile_left" | "smile_right" | "contempt";

/** A label or word, its start and end in s from the utterance's beginning. */
export type Timed = [text: string, start: number, end: number];

export interface SayOptions {
  /** Language code of the voice; else the server's. */
  voice?: string;
  /** Words a minute, 80 to 449. */
  rate?: number;
}

export interface TimedFields {
  /** Engine time of the beginning, s; else now, or behind what is said. */
  at_s?: number;
  /** The beginning waits for a message `audio`. */
  audio?: boolean;
  /** Number of the utterance that these continue. */
  utterance?: number;
  /** False: more follows. */
  last?: boolean;
}

export interface PhoneDetail {
  /** With a server. */
  utterance?: number;
  label: string;
  word: string | null;
  position_s: number;
}

export interface UtteranceDetail {
  utterance: number;
}

export interface FapFaceEventMap extends Omit<HTMLElementEventMap, "error"> {
  /** What is wrong. */
  error: CustomEvent<string>;
  ready: CustomEvent<undefined>;
  connection: CustomEvent<"connecting" | "connected" | "waiting">;
  started: CustomEvent<UtteranceDetail | undefined>;
  phone: CustomEvent<PhoneDetail>;
  finished: CustomEvent<UtteranceDetail | undefined>;
  cancelled: CustomEvent<UtteranceDetail | undefined>;
  /** The device that `hear` follows was unplugged; it, or another, is there again. */
  lost: CustomEvent<undefined>;
  regained: CustomEvent<undefined>;
  picture: CustomEvent<undefined>;
  /** The graphics card stopped: nothing is drawn until `contextrestored`, and the face follows unseen. */
  contextlost: CustomEvent<undefined>;
  /** The face is drawn again, by itself. */
  contextrestored: CustomEvent<undefined>;
}

/** The element `<fap-face>`. */
export class FapFace extends HTMLElement {
  /** Resolves when the face is there; rejects with what is wrong, or where it is not in a document. */
  readonly ready: Promise<void>;
  /** What is shown now. */
  readonly faps: Faps;
  /** True: this page plays no sound of the server's voice. */
  muted: boolean;
  /** With a server: its voice speaks; resolves to whether it was sent. */
  say(text: string, options?: SayOptions): Promise<boolean>;
  /** Without server and src: phones with times. `clock` gives the position of what is heard, s; by default it begins now. */
  say(phones: TimedPhone[], options?: LiveSayOptions): Promise<void>;
  /** Without server and src: a text (English, or by `pronounce`), or words with times; null if something else was begun. */
  say(words: string | TimedWord[], options?: LiveSayOptions): Promise<SaidWords | null>;
  /** Without server and src: follow sound. Resolves to the delayed sound, to be connected where it is heard. */
  hear(input: MediaStream | AudioNode | MediaStreamConstraints, options?: HearOptions): Promise<AudioNode>;
  push(samples: Int16Array, rate: number): boolean;
  words(words: Timed[], fields?: TimedFields & { voice?: string }): boolean;
  phones(phones: Timed[], fields?: TimedFields & { set?: string }): boolean;
  express(name: Expression, level?: number, fields?: object): boolean | Promise<void>;
  look(yaw: number, pitch: number): boolean;
  cancel(): void;
  play(): Promise<void>;
  pause(): void;
  feed(data: ArrayBuffer | ArrayBufferView): boolean;
  listen(target: EventTarget): void;
  addEventListener<K extends keyof FapFaceEventMap>(
    type: K, listener: (this: FapFace, event: FapFaceEventMap[K]) => unknown, options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string, listener: EventListenerOrEventListenerObject, options?: boolean | AddEventListenerOptions,
  ): void;
}

export interface Track {
  rate: number;
  times: number[];
  frames: Faps[];
}

/** Read a .fap file. */
export function parseFap(text: string): Track;

/** What gives FAPs at a time of the page. */
export interface Source {
  readonly isSpeaking: boolean;
  sample(now: number, faps: Faps): { time: number } | null;
  close?(): void;
}

/** A .fap file that is played, its sound beside it. */
export class Player extends EventTarget implements Source {
  constructor(track: Track, audio?: string | URL | null);
  isSpeaking: boolean;
  duration: number;
  play(): Promise<void>;
  pause(): void;
  close(): void;
  sample(now: number, faps: Faps): { time: number };
}

/** Frames of FAPs from a data channel. */
export class Channel implements Source {
  constructor(rate?: number);
  readonly isSpeaking: boolean;
  push(data: ArrayBuffer | ArrayBufferView): boolean;
  listen(target: EventTarget): void;
  close(): void;
  sample(now: number, faps: Faps): { time: number } | null;
}

/** A session of `fapengine serve`. */
export class Session extends EventTarget implements Source {
  constructor(where: { server: string | URL; session?: string; token?: string | null });
  readonly isSpeaking: boolean;
  say(text: string, options?: SayOptions): boolean;
  express(name: Expression, level?: number, fields?: object): boolean;
  look(yaw: number, pitch: number): boolean;
  push(samples: Int16Array, rate: number): boolean;
  send(type: string, fields?: object): boolean;
  cancel(): boolean;
  pause(wanted: boolean): void;
  play(wanted: boolean): Promise<boolean>;
  close(): void;
  sample(now: number, faps: Faps): { time: number } | null;
}

/** A head as `head.bin` has it. */
export interface Head {
  parts: Record<string, Uint32Array>;
  [name: string]: unknown;
}

/** Read a `head.bin`. */
export function parseHead(buffer: ArrayBuffer): Head;

/** Content of a `setup.json`: shaders, cameras by name, colour of the wall (linear RGB). */
export interface Setup {
  cameras: Record<string, object>;
  wall: number[];
  [name: string]: unknown;
}

/** Where one looks from. */
export class Steering {
  /** @param moved Called with the name of a camera that is flown to, or null. */
  constructor(cameras: Setup["cameras"], moved?: (name: string | null) => void);
  /** To a camera by its name or number. */
  fly(which: string | number, options?: { atOnce?: boolean }): void;
  /** A hand, wheel and keys on the canvas turn the camera. */
  listen(canvas: HTMLCanvasElement): void;
}

/** A canvas that shows a face, as often as there is something new to see. */
export class Picture {
  /** @param sample As of a Source. @param options.wall Linear RGB; null, by default, is transparent. */
  constructor(
    canvas: HTMLCanvasElement, setup: Setup, head: Head, sample: Source["sample"], steering: Steering,
    options?: {
      wall?: number[] | null; edges?: "fine" | "soft" | null; rest?: number | string | null; isBusy?: () => boolean; shown?: () => void;
    },
  );
  readonly faps: Faps;
  /** Why nothing can be drawn. */
  readonly trouble?: string;
  wear(head: Head): void;
  close(): void;
}

/** Attributes of `<fap-face>`. */
export interface FapFaceAttributes {
  server?: string;
  session?: string;
  token?: string;
  src?: string;
  audio?: string;
  /** Name of a server's head, or address of a head.bin. */
  head?: string;
  /** Address of a setup.json. */
  setup?: string;
  camera?: string;
  transparent?: boolean | "";
  edges?: "fine" | "soft";
  rest?: number | string;
  /** Without a server: no blinks, glances, nods, head motion and variation. */
  still?: boolean | "";
  /** Without a server: natural variation of speech, 0 to 1 (default). */
  liveliness?: number | string;
}

declare global {
  interface HTMLElementTagNameMap {
    "fap-face": FapFace;
  }
}
