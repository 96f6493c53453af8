r"""Backslash trigraphs, in which Praat writes IPA in ASCII: ``\sh`` is ʃ.

Source: Praat manual, "Phonetic symbols: consonants", "vowels" and "diacritics", and the table in Praat's longchar.cpp.
"""

import re

_PAIRS = """
    at ɐ  as ɑ  ay ɒ  ab ɒ  ae æ  o/ ø  oe œ  Oe ɶ  e- ɘ  sw ə  sr ɚ  ef ɛ  er ɜ  kb ɞ  rh ɤ  i- ɨ
    ic ɪ  mt ɯ  o- ɵ  ct ɔ  u- ʉ  hs ʊ  vt ʌ  yc ʏ  dh ð  h- ħ  b^ ɓ  bc ʙ  cc ɕ  c, ç  d. ɖ  d^ ɗ
    j- ɟ  g^ ɠ  gs ɡ  gc ɢ  gf ɣ  G^ ʛ  ht ɥ  h^ ɦ  hj ɧ  hc ʜ  jc ʝ  l~ ɫ  l- ɬ  l. ɭ  lz ɮ  lc ʟ
    ml ɰ  mj ɱ  ng ŋ  nj ɲ  n. ɳ  nc ɴ  ff ɸ  bf β  tf θ  te θ  cf χ  rt ɹ  rl ɺ  r. ɻ  f. ɽ  fh ɾ
    rc ʀ  ri ʁ  s. ʂ  sh ʃ  j^ ʄ  t. ʈ  vs ʋ  wt ʍ  yt ʎ  z. ʐ  zc ʑ  zh ʒ  ?g ʔ  9e ʕ  ?- ʡ  9- ʢ
    O. ʘ  |1 ǀ  |2 ǁ  |- ǂ  :f ː  .f ˑ  '1 ˈ  '2 ˌ  ~^ \u0303  |v \u0329  0v \u0325  hr ˞
"""
TRIGRAPHS = dict(zip(_PAIRS.split()[::2], _PAIRS.split()[1::2], strict=True))
"""The two characters after a backslash, and what Praat shows for the three."""


def from_trigraphs(label: str) -> str:
    r"""Replace the trigraphs in a label.

    Examples
    --------
    >>> from_trigraphs(r"\sh"), from_trigraphs(r"t\sh"), from_trigraphs(r"\ae\~^"), from_trigraphs("r\\")
    ('ʃ', 'tʃ', 'æ̃', 'r\\')
    """
    return re.sub(r"\\(..)", lambda match: TRIGRAPHS.get(match[1], match[0]), label)
