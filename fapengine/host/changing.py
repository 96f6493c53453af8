"""Phones of a recognizer for the engine, the last of which may still change."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fapengine.engine.commands import Append, End
from fapengine.speech.phone_track import SILENCE, Phone

OPEN_S = 0.01
"""Time by which a phone that is not over is taken to last longer: of 0, 10, 20 and 40 ms the best for 32 recordings of
flite by the small network, 0.25 s after the sound (mean r .897, .899, .896, .888)."""


@dataclass(slots=True)
class ChangingPhones:
    """Phones of one utterance. Stateful: it remembers which of them the engine has.

    Examples
    --------
    >>> phones = ChangingPhones(1)
    >>> phones.append([], [Phone("m", 0.0, 0.1)]).revision
    0
    >>> changed = phones.append([Phone("b", 0.0, 0.08)], [Phone("a", 0.08, 0.2)])
    >>> changed.first_index, changed.revision, [phone.label for phone in changed.phones]
    (0, 1, ['b', 'a'])
    """

    utterance: int
    """The engine's number."""
    count: int = 0
    """Number of its final phones."""
    partial: tuple[Phone, ...] = ()
    """Phones after these, as the engine has them."""
    revision: int = 0

    def append(self, final: Sequence[Phone], partial: Sequence[Phone] = ()) -> Append | None:
        """Add final phones, and replace those that may have changed.

        Parameters
        ----------
        final, partial : sequence of Phone
            In the utterance's time: the next final phones, and those after them that may still change.

        Returns
        -------
        Append or None
            What the engine does not have yet.
        """
        if partial and not partial[-1].is_silence:  # it is not over yet
            partial = [*partial[:-1], replace(partial[-1], end_s=partial[-1].end_s + OPEN_S)]
        phones, known = (*final, *partial), self.partial
        if not phones and any(not phone.is_silence for phone in known):  # all of them were taken back
            phones = (Phone(SILENCE, known[0].start_s, known[-1].end_s),)
        if not phones:
            return None
        is_longer = phones[: len(known)] == known
        first = len(known) if is_longer else 0
        first_index = self.count + first
        self.count += len(final)
        self.partial = phones[len(final) :]
        if not phones[first:]:
            return None
        self.revision += not is_longer
        return Append(self.utterance, first_index, phones[first:], self.revision, keeps_earlier=True)

    def end(self, duration_s: float) -> End:
        """Return the command that ends the utterance, with its length in s."""
        return End(self.utterance, self.count + len(self.partial), duration_s, self.revision)
