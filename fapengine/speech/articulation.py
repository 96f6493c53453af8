"""Positions of lips and tongue for each IPA symbol, in mm: a built-in table of what no video tracker has measured.

The profile's recordings show how far a mouth opens and how wide it is; they show little of how far lips come forward
(a single camera) and nothing of the tongue. This table has values for that, with source and uncertainty. Length,
nasalisation and tone are ignored, because they are invisible (:func:`.ipa.letters` drops their marks).

Axes of a symbol's row in ``articulation.csv``, in the order of :data:`AXES`:

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

from fapengine._arrays import read_rows

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


ARTICULATIONS: dict[str, Articulation] = {
    letter: Articulation(source, *map(float, numbers))
    for letters, *numbers, source in read_rows("fapengine.speech", "articulation.csv")
    for letter in letters
}
"""The articulation of every symbol of :data:`.ipa.SOUNDS`."""
_OPENINGS = [
    (letter, float(in_words), float(alone))
    for letters, in_words, alone in read_rows("fapengine.speech", "openings.csv")
    for letter in letters
]
OPENINGS = {letter: in_words for letter, in_words, _ in _OPENINGS}
"""Millimetres by which lips are apart in unrounded vowels, ɹ and l, for a speaker whose vowels open as far as the
recorded one's. Uncertainty 2 mm. JD3 has 9.3 for i, 8.5 ɪ, 8.4 e, 8.6 ə, 9.8 ɛ, 9.9 a, 10.2 ɐ, the jaw lower than for
i by 2.6, 1.3, 4.3, 4.5, 4.0, 4.3 mm; the recorded lips open by 1.45 times the chin's way. The table is about the mean
of JD3's lips and of what his jaw would make of the recorded ones (i 7.2, ɪ 8.6, e 7.7, ɛ 10.7, ɐ 10.8), drawn to the
chart's order; a, ɑ and æ are what the recorded aɪ begins with (11 to 14); ɨ ɯ ɤ ɘ ə ɜ ʌ by chart; l between JD3's 9.3
to 9.9 and the recorded 4.8, ɹ our own judgement: the recorded one, labial as in "green", is nearly shut alone."""
OPENINGS_ALONE = {letter: alone for letter, _, alone in _OPENINGS}
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
