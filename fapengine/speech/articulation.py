"""Positions of lips and tongue for each IPA symbol, in mm: a built-in table of what no video tracker has measured.

The profile's recordings show how far a mouth opens and how wide it is; they show little of how far lips come forward
(a single camera) and nothing of the tongue. This table has values for that, with source and uncertainty. Length,
nasalisation and tone are ignored, because they are invisible (:func:`.ipa.letters` drops their marks).

Axes of a symbol's row, in the order of :data:`AXES`:

- ``push``: both lips forward from rest, mm, mean of upper and lower.
- ``round``: what the corners of the mouth are held to, 1 narrow, 0 free, -1 spread.
- ``tip_up``, ``tip_out``: the tongue's tip up and forward, mm, from rest. At rest the tongue is flat, its tip at the
  edge between upper and lower teeth (neutral face of ISO/IEC 14496-2, Annex C). The tongue rides on the jaw, so
  what reaches the palate is as much higher as the jaw is down for that letter, 3 to 5 mm.
- ``body_up``: the middle of the tongue up, mm.

``insists`` is the resistance to coarticulation, 0 to 1: at 1 a symbol takes nothing from its neighbours, at 0 all.

Sources:

- JD3: speaker file JD3 of VocalTractLab, one German man, shapes fitted to MRI (method: Birkholz 2013, PLoS ONE 8(4)
  e60603, doi:10.1371/journal.pone.0060603); numbers are used as facts. Insisting is the slope over contexts a, i, u:
  protrusion of p is 1.4, 1.5, 6.7 mm where the vowels have 1.4, 1.5, 10.7.
- ICT: shapes of ICT-FaceKit (MIT licence): a pucker is 6.9 and 9.0 mm of upper and lower lip, a funnel 6.3 and 6.6.
- Toda: Toda, Maeda, Carlen and Meftahi 2003, Proc. 15th ICPhS, p. 1763: ʃ ʒ protrude with a large opening of the lips,
  w with a narrow one. JD3 has but 2.4 mm between ʃ and s; here ʃ has a funnel's size, so that the two are told apart.
- King and Ferragne 2020, J. Phonetics 80, 100978: ɹ of 24 English speakers.
- chart: no measurement; the value of the letter's neighbour in the chart of the International Phonetic Association.
"""

from dataclasses import dataclass

AXES = ("push", "round", "tip_up", "tip_out", "body_up")


@dataclass(frozen=True, slots=True)
class Articulation:
    """One row of the table."""

    source: str
    push: float
    """Both lips forward, mm."""
    round: float
    """Corners: 1 narrow, 0 free, -1 spread."""
    tip_up: float
    """Tongue tip up, mm."""
    tip_out: float
    """Tongue tip forward, mm."""
    body_up: float
    """Middle of the tongue up, mm."""
    lips_insist: float
    """0..1, of ``push`` and ``round``."""
    tongue_insists: float
    """0..1, of the tongue."""
    sure_mm: float
    """Uncertainty, mm, standard deviation: spread between speakers and contexts, our estimate."""

    @property
    def values(self) -> tuple[float, ...]:
        """Values in the order of :data:`AXES`."""
        return self.push, self.round, self.tip_up, self.tip_out, self.body_up

    @property
    def insists(self) -> tuple[float, ...]:
        """Insisting of each of :data:`AXES`."""
        return (self.lips_insist,) * 2 + (self.tongue_insists,) * 3


# fmt: off
_ROWS: tuple[tuple[str, tuple[float, ...], str], ...] = (
    # letters; push, round, tip_up, tip_out, body_up, lips_insist, tongue_insists, sure_mm; source
    ("i",    ( 0.0, -1.0,  0.0, -1.0,  8.0, 1.0, 1.0, 2), "JD3 i"),
    ("ɪ",    ( 0.0, -0.6,  0.0, -1.0,  3.0, 0.9, 0.9, 2), "JD3 ɪ"),
    ("e",    ( 0.0, -0.8, -1.0, -2.0,  7.0, 1.0, 1.0, 2), "JD3 e"),
    ("ɛ",    ( 0.0, -0.5, -2.0, -2.0,  0.0, 0.9, 0.9, 2), "JD3 ɛ"),
    ("æ",    ( 0.0, -0.5, -3.0, -3.0, -2.0, 0.9, 0.9, 3), "chart, ɛ and a"),
    ("a",    ( 0.0,  0.0, -5.0, -5.0, -2.0, 0.9, 0.9, 2), "JD3 a"),
    ("ɑʌɐ",  ( 0.0,  0.0, -5.0, -5.0, -4.0, 0.9, 0.9, 3), "JD3 ɐ; ɑ ʌ by chart"),
    ("əɘ",   ( 0.0,  0.0,  0.0,  0.0,  0.0, 0.4, 0.5, 2), "JD3 ə; ɘ by chart"),
    ("ɜ",    ( 0.0,  0.0,  0.0, -1.0,  0.0, 0.8, 0.8, 3), "chart, ə"),
    ("ɨ",    ( 0.0, -0.4, -1.0, -4.0,  7.0, 0.9, 0.9, 3), "chart, i and ɯ"),
    ("ɯɤ",   ( 0.0, -0.4,  0.0, -8.0,  7.0, 0.9, 0.9, 3), "chart, tongue of u and o, lips of i"),
    ("ɚɝ",   ( 4.0,  0.3,  3.0, -8.0,  3.0, 0.8, 0.9, 4), "chart, ɹ and ə"),
    ("y",    ( 9.0,  1.0, -1.0, -1.0,  8.0, 1.0, 1.0, 2), "JD3 y, 8.7"),
    ("ʏ",    ( 8.5,  0.9, -2.0, -2.0,  2.0, 1.0, 0.9, 2), "JD3 ʏ, 8.9"),
    ("ø",    ( 9.0,  0.9, -1.0, -2.0,  6.0, 1.0, 1.0, 2), "JD3 ø, 9.4"),
    ("œɶ",   ( 6.0,  0.7, -3.0, -4.0, -3.0, 1.0, 0.9, 3), "JD3 œ, 4.2, and ø, 9.4; ɶ by chart"),
    ("ɵʉɞ",  ( 8.5,  0.9, -1.0, -4.0,  5.0, 1.0, 0.9, 3), "chart, y, ø and u"),
    ("u",    (10.0,  1.0,  0.0,-10.0,  8.0, 1.0, 1.0, 2), "JD3 u, 10.7"),
    ("ʊ",    ( 8.5,  0.9, -2.0, -8.0,  5.0, 1.0, 0.9, 2), "JD3 ʊ, 8.6"),
    ("o",    ( 8.5,  0.9, -1.0,-12.0,  5.0, 1.0, 1.0, 2), "JD3 o, 7.6; ICT"),
    ("ɔ",    ( 6.0,  0.7, -5.0, -8.0,  0.0, 1.0, 0.9, 3), "JD3 ɔ, 4.9"),
    ("ɒ",    ( 4.5,  0.5, -5.0, -8.0, -3.0, 0.9, 0.9, 3), "chart, ɔ and ɑ"),
    ("pbm",  ( 0.0,  0.0,  0.0,  0.0,  0.0, 0.4, 0.1, 2), "JD3 p in a, i, u: 1.4, 1.5, 6.7"),
    ("ɓʘʙɸβ", (0.0,  0.0,  0.0,  0.0,  0.0, 0.4, 0.1, 3), "chart, p"),
    ("fvɱʋⱱ", (-1.0, 0.0,  0.0, -2.0,  0.0, 0.85, 0.1, 2), "JD3 f in a, i, u: -2.9, -1.0, 1.7; lip on teeth"),
    ("θð",   ( 0.0, -0.2,  3.5, 11.0,  0.0, 0.6, 1.0, 2), "JD3 θ: tip 2.2 to 3.1 mm before the upper incisors"),
    ("tdn",  ( 0.0,  0.0,  9.0, -3.0,  1.0, 0.2, 0.9, 2), "JD3 t: tip at the ridge; lips of the vowel"),
    ("ɗǀ",   ( 0.0,  0.0,  9.0, -3.0,  1.0, 0.2, 0.9, 3), "chart, t"),
    ("lɫɬɮɺ", (0.0,  0.0, 10.0, -2.0,  0.0, 0.2, 0.9, 2), "JD3 l"),
    ("rɾǃǁ", ( 0.0,  0.0,  9.0, -5.0,  0.0, 0.2, 0.9, 3), "chart, t"),
    ("sz",   ( 0.0, -0.2,  5.0, -2.0,  1.0, 0.67, 0.9, 2), "JD3 s in a, i, u: 1.9, 1.2, 4.6; tip 4 mm up"),
    ("ʃʒ",   ( 8.0,  0.5,  7.0, -8.0,  4.0, 0.8, 0.9, 3), "Toda; ICT; JD3 ʃ in a, i, u: 4.0, 3.9, 6.9"),
    ("ʂʐ",   ( 6.0,  0.3,  9.0, -9.0,  2.0, 0.7, 0.9, 4), "chart, ʃ; the tip turned up"),
    ("ɕʑ",   ( 0.0, -0.4,  4.0, -4.0,  7.0, 0.7, 0.9, 3), "chart, ç and s: not rounded"),
    ("ɧ",    ( 5.0,  0.5,  2.0, -6.0,  6.0, 0.6, 0.9, 4), "chart, ʃ and x"),
    ("ɹ",    ( 6.0,  0.4,  6.0, -8.0,  3.0, 0.7, 0.9, 3), "King and Ferragne 2020: labial, unlike w; sizes ours"),
    ("ɻ",    ( 6.0,  0.4,  9.0,-10.0,  3.0, 0.7, 0.9, 4), "chart, ɹ"),
    ("ʈɖɳɭɽ", (1.0,  0.0, 10.0, -9.0,  1.0, 0.3, 0.9, 4), "chart, t; the tip turned back"),
    ("jʎɲ",  ( 0.0, -0.6,  0.0, -2.0,  9.0, 0.5, 0.9, 3), "JD3 i and ç; chart"),
    ("cɟʄǂçʝ", (0.0, -0.3, 1.0, -3.0,  9.0, 0.5, 0.9, 3), "JD3 ç in a, i, u: 1.7, 1.7, 5.4"),
    ("w",    (10.0,  1.0,  0.0,-10.0,  8.0, 1.0, 0.9, 2), "JD3 u; Toda: narrow"),
    ("ʍ",    (10.0,  1.0,  0.0,-10.0,  8.0, 1.0, 0.9, 3), "chart, w"),
    ("ɥ",    ( 9.0,  1.0, -1.0, -1.0,  9.0, 1.0, 0.9, 3), "JD3 y"),
    ("kɡŋ",  ( 0.0,  0.0, -1.0, -5.0, 10.0, 0.17, 0.8, 2), "JD3 k in a, i, u: 1.4, 0.4, 8.6; body at the palate"),
    ("ɠɰʟ",  ( 0.0,  0.0, -1.0, -5.0,  9.0, 0.2, 0.8, 3), "chart, k"),
    ("xɣ",   ( 0.0,  0.0, -1.0, -4.0,  6.0, 0.5, 0.8, 3), "JD3 x in a, i, u: 1.9, 1.9, 6.0"),
    ("χʁ",   ( 0.0,  0.0, -1.0, -4.0,  4.0, 0.5, 0.8, 3), "JD3 χ"),
    ("qɢʛɴʀ", (0.0,  0.0, -2.0, -6.0,  5.0, 0.2, 0.8, 4), "chart, k and χ"),
    ("ħʕʜʢ", ( 0.0,  0.0, -4.0, -6.0, -3.0, 0.2, 0.6, 4), "chart, ɑ"),
    ("hɦʔʡ", ( 0.0,  0.0,  0.0,  0.0,  0.0, 0.05, 0.05, 2), "no gesture of lips or tongue"),
)
# fmt: on


ARTICULATIONS: dict[str, Articulation] = {
    letter: Articulation(source, *numbers) for letters, numbers, source in _ROWS for letter in letters
}
"""The articulation of every symbol of :data:`.ipa.SOUNDS`."""
OPENINGS = {
    letter: opening_mm
    for letters, opening_mm in (
        ("i", 7.0), ("ɨɯ", 7.5), ("ɪeəɘɤʌ", 8.5), ("ɜ", 9.0), ("ɛ", 10.5), ("ɐ", 11.0), ("æ", 11.5), ("a", 12.0),
        ("ɑ", 13.0),
        ("ɹ", 4.0), ("l", 6.5),
    )
    for letter in letters
}  # fmt: skip
"""Millimetres by which lips are apart in unrounded vowels, ɹ and l, for a speaker whose vowels open as far as the
recorded one's. Uncertainty 2 mm. JD3 has 9.3 for i, 8.5 ɪ, 8.4 e, 8.6 ə, 9.8 ɛ, 9.9 a, 10.2 ɐ, the jaw lower than for
i by 2.6, 1.3, 4.3, 4.5, 4.0, 4.3 mm; the recorded lips open by 1.45 times the chin's way. The table is about the mean
of JD3's lips and of what his jaw would make of the recorded ones (i 7.2, ɪ 8.6, e 7.7, ɛ 10.7, ɐ 10.8), drawn to the
chart's order; a, ɑ and æ are what the recorded aɪ begins with (11 to 14); ɨ ɯ ɤ ɘ ə ɜ ʌ by chart; l between JD3's 9.3
to 9.9 and the recorded 4.8, ɹ our own judgement: the recorded one, labial as in "green", is nearly shut alone."""
OPENINGS_ALONE = {
    letter: opening_mm
    for letters, opening_mm in (
        ("i", 6.7), ("ɨɯ", 7.3), ("ɪ", 7.6), ("e", 8.5), ("əɘɤʌ", 8.6), ("ɜ", 9.2), ("ɛ", 10.2),
        ("ɐ", 11.0), ("æ", 11.1), ("a", 12.2), ("ɑ", 13.3), ("ɹ", 5.5), ("l", 6.5),
    )
    for letter in letters
}  # fmt: skip
"""The same of letters said alone, where a difference must be seen without a word to help: the order of :data:`OPENINGS`
in steps of about 1 mm, none of them farther from it than 1.5 mm, which is within its uncertainty. In words these values
made new words harder to read (21.3 % misread in place of 19.7 %)."""
SIBILANTS = frozenset("szʃʒɕʑʂʐ")
"""Consonants with the teeth close together: of all consonants the jaw is highest and varies least (Mooshammer, Hoole
and Geumann 2007, "Jaw and order", Language and Speech 50, 145)."""
PUCKERED = frozenset("uyoøʉɵwʍɥ")
"""Tense rounded vowels and their glides: lips that go on narrowing while the sound lasts."""
SPREAD = frozenset("ie")
"""Tense front vowels: corners that go on drawing apart while the sound lasts."""
