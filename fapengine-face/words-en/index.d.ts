/** Phones of English words. */
export class English {
  /** @param options.assets Address of `assets/words-en.bin` elsewhere. */
  static make(options?: { assets?: { words?: string | URL } }): Promise<English>;
  /** @param buffer Content of `assets/words-en.bin`. */
  constructor(buffer: ArrayBuffer);
  /** Phones (IPA, `ˈ` before the vowel of a stressed word) of words that follow each other without a pause; null for what is not English. */
  pronounce(texts: string[]): (string[] | null)[];
}
