"""What a voice of espeak-ng is given to speak: amounts, units, ordinals, years and abbreviations as words.

Theory of operation
-------------------
A language's table (``spoken/CODE.toml``) is read when a text of that language first has a digit, a sign or a short word
with a point in it. Its entries find stretches of the text; the first that finds a stretch has it. Each is replaced by
words, and every character of the words has the place of what it stands for. So captions, marks and times of words have
the caller's text: ``$3.50`` is one word with the phones of "three dollars fifty". Where several words of the text are
replaced at once (``3,50 €``), they share the spoken ones in order.

A table has ``[words]`` (abbreviations), ``[units]`` and ``[currencies]`` beside a number, each with one form, two (one,
other), three (one, few, many: Russian) or four (and part: Polish), ``[cents]`` of currencies, ``[fractions]``, and
``[[rules]]``: a regular expression and what is said, in which ``{1}`` is its first group and ``{0}`` its group ``n`` in
words. Its group ``x`` is replaced, or all. ``{month}`` in a regular expression is what ``[patterns]`` has as ``month``.
``scales`` are words between a number and its currency, ``of`` what stands after one, ``[short_scales]`` letters for
them (``$5k``). ``starters`` begin a sentence after an abbreviation, whose point is then a full stop too. ``minus`` is
said before a number, ``share`` between a fraction and its unit. ``[mixed]`` has what a fraction becomes after a whole
number, or after its unit (``2 kilos et demi``) if it is ``last``, and for a unit apart if that follows in its key, and
before ``rate`` in a unit (``1½ km/h``); ``unit_first`` is true where a unit stands before its number, ``elides`` where
a letter may belong to the next word (``l'eau``); ``to`` is said between two amounts. After ``one_after`` a unit has its
first form whatever the number (``a 5 km walk``). A fraction's sign (``½``) is what
its digits are. ``[date]`` has ``months``, what is ``said``, and forms of ``year`` and of ``day``, by what stands before
the date; ``year_first`` is true where 12/05/2024 may be one of two. ``phones`` is a pattern of telephone numbers beside
the usual one. ``joined`` is the greatest number of digits before a space in a number that the voice would read in
parts. ``[[gender]]`` has ``nouns``, what the number in words before one becomes at its ``ends`` (regular expressions),
and what must stand ``before`` both, if anything.

Tags of SSML stay, what stands in ``say-as``, ``sub`` and ``phoneme``, and addresses of the web and of mail, but for
their points if the table has a ``dot``.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, product
from typing import Any

from fapengine._arrays import read_tables
from fapengine._late import needed
from fapengine.speech.text.normal_form import SpeakableText

LANGUAGES = ("ar", "bn", "cmn", "de", "en", "es", "fr", "hi", "id", "it", "ja", "pl", "pt", "ru", "sw", "tr")
"""Languages with a table."""
_OCCASION = re.compile(
    r"\d|\b\w{1,4}\.|[^\W\d_]\.\s*\w|[^\w\s.,;:!?'’\"<>/=-]|\bng['’]|\b[ДдГг]-|\b[IVX]{2}|\bIer\b|[а-я] [IVX]\b"
    r"|[¼-¾⅓⅔⅛]"
)
"""Finds what a table may rewrite: digits, Roman numerals, fractions, signs, and abbreviations of up to four letters."""
_NUMBER = r"(?P<n>(?>\d+(?:[.,\u00a0\u202f]\d{3}(?!\d))*(?:[.,]\d+)?))"
_SPACED_NUMBER = _NUMBER.replace("[.,", "[., ", 1)
_NUMBER_BEFORE = re.compile(r"\d[ \u00a0\u202f]?$")
_TO = r"(?P<to>[-–]\d+(?:[.,]\d+)*)"
"""Second number of a range."""
_GAP = r"[ \u00a0\u202f]?"
ADDRESS = re.compile(r"\b(?:https?://|www\.)[^\s<>]+|\b[\w.+-]{1,64}@[\w-]{1,64}\.\w[^\s<>]*")
"""Of the web, or of mail."""
_KEPT = re.compile(
    rf"<(say-as|sub|phoneme)\b[^<>]*[^/<>]>.*?</\1\s*>|<[^<>]*>|\[\[.*?\]\]|{ADDRESS.pattern}", re.DOTALL
)
_POINT = re.compile(r"\.(?=\w)")
_CENTS = re.compile(r"(.*)[.,](\d\d)")

Edit = tuple[int, int, str]
"""Start and stop of a stretch of the text, and what is spoken in its place."""


@dataclass(frozen=True, slots=True)
class _Rule:
    """A pattern, and the edits of each of its matches."""

    pattern: re.Pattern[str]
    edits: Callable[[re.Match[str]], list[Edit]]


def spoken_form(text: str, code: str, given: Sequence[Edit] = ()) -> SpeakableText:
    """Put into words what a voice would spell.

    Parameters
    ----------
    text : str
        In normal form, plain or SSML.
    code : str
        Language code of the voice.
    given : sequence of Edit
        Edits that are made anyway, of what stands in tags.

    Examples
    --------
    >>> spoken = spoken_form("Dr. Lee paid $3.50.", "en-us")
    >>> spoken.text
    'Doctor Lee paid 3 dollars 50.'
    >>> spoken.starts[spoken.text.index("dollars")]
    13
    """
    language = code.partition("-")[0]
    edits = list(given)
    if language in LANGUAGES and _OCCASION.search(text):
        taken = bytearray(len(text))
        for start, stop, _ in given:
            taken[start:stop] = b"\1" * (stop - start)
        dot = _table(language).get("dot")
        for kept in _KEPT.finditer(text):
            if dot and kept[0][0] not in "<[":
                points = (point.start() for point in _POINT.finditer(text, *kept.span()))
                edits += [(at, at + 1, f" {dot} ") for at in points if not taken[at]]
            taken[kept.start() : kept.end()] = b"\1" * len(kept[0])
        for rule in _rules(language):
            for match in rule.pattern.finditer(text):
                found = [part for edit in rule.edits(match) for part in _shared_out(text, *edit)]
                if not any(any(taken[start:stop]) for start, stop, _ in found):
                    edits += found
                    for start, stop, _ in found:
                        taken[start:stop] = b"\1" * (stop - start)
    return edited(text, sorted(edits))


def _shared_out(text: str, start: int, stop: int, said: str) -> list[Edit]:
    """Share what is said among the words that it stands for, in order.

    Examples
    --------
    >>> _shared_out("3,50 €", 0, 6, "3 Euro 50")
    [(0, 4, '3 Euro'), (5, 6, '50')]
    """
    words, spoken = list(re.finditer(r"\S+", text[start:stop])), said.split()
    if len(words) < 2 or len(spoken) < len(words):
        return [(start, stop, said)]
    ends = [round((index + 1) * len(spoken) / len(words)) for index in range(len(words))]
    return [
        (start + word.start(), start + word.end(), " ".join(spoken[first:last]))
        for word, first, last in zip(words, [0, *ends], ends, strict=False)
    ]


def edited(text: str, edits: list[Edit]) -> SpeakableText:
    """Replace stretches of a text, in order and without overlap; each character keeps its place in the original."""
    pieces, starts, stops = [], [], []
    done = 0
    for start, stop, words in [*edits, (len(text), len(text), "")]:
        pieces += [text[done:start], words]
        starts += [*range(done, start), *[start] * len(words)]
        stops += [*range(done + 1, start + 1), *[stop] * len(words)]
        done = stop
    return SpeakableText("".join(pieces), tuple(starts), tuple(stops))


_SIGNS = {"1/2": "½", "1/3": "⅓", "2/3": "⅔", "1/4": "¼", "3/4": "¾", "1/8": "⅛"}
_PARTS = "".join(_SIGNS.values())


@cache
def _table(language: str) -> dict[str, Any]:
    table = read_tables(__package__, f"spoken/{language}.toml")
    for rule, (name, pattern) in product(table.get("rules", ()), table.get("patterns", {}).items()):
        rule["find"] = rule["find"].replace(f"{{{name}}}", pattern)
    fractions, gap = table.setdefault("fractions", {}), " " if table.get("spaced", True) else ""
    for plain, sign in _SIGNS.items():
        fractions |= {key.replace(plain, sign): said for key, said in fractions.items() if plain in key}
        fractions |= {key.replace(f" {sign}", sign): said for key, said in fractions.items() if f" {sign}" in key}
        if said := table.get("mixed", {}).get(plain):
            joined, apart = rf"(?<=\d){sign}", rf"(?<=\d )(?:{sign}|{plain})(?![\d/])"
            table.setdefault("rules", []).extend([{"find": joined, "say": gap + said}, {"find": apart, "say": said}])
    return table


@cache
def _rules(language: str) -> tuple[_Rule, ...]:
    table = _table(language)
    words, units = _words(table), _units(table, language)
    last = (units, words) if table.get("spaced", True) else (words, units)  # 1人 has a word of its own
    first = _dates(table, language), _phones(table), _prices(table, language), _genders(table, language)
    mixed = units if table.get("unit_first") else _mixed_units(table, language)
    return tuple(chain(*first, _numbers(table, language), mixed, _fractions(table), _listed(table, language), *last))


_DATE = re.compile(
    r"(?<![\w.,/:-])(?:(?P<d>\d{1,2})(?P<s>[./-])(?P<m>\d{1,2})(?P=s)(?P<y>\d{4})"
    r"|(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d))(?![\w/-]|[.,:]\d)"
)


def _dates(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    if not (date := table.get("date")):
        return

    def in_form(number: str, form: str) -> str:
        kind, _, ending = form.partition(" ")
        return _FORMS[kind](number, language) + ending if form else str(int(number))

    def edits(match: re.Match[str]) -> list[Edit]:
        day, month, year = (match[name] or match[name[0]] for name in ("day", "month", "year"))
        if date.get("year_first") and not match["year"]:
            if int(month) > 12 >= int(day):
                day, month = month, day  # 11/28/2026 can only be one day
            elif int(day) <= 12:
                return [(*match.span(), match[0])]
        if not (1 <= int(day) <= 31 and 1 <= int(month) <= 12):
            return []
        before = match.string[: match.start()]
        forms = date.get("day", {}).items()
        form = next((form for words, form in forms if not words or re.search(rf"\b(?:{words}) \Z", before)), "")
        said_day = date["first"] if int(day) == 1 and "first" in date else in_form(day, form)
        month, year = date["months"][int(month) - 1], in_form(year, date.get("year", ""))
        return [(*match.span(), date["said"].format(day=said_day, month=month, year=year))]

    yield _Rule(_DATE, edits)


_PHONE = r"(?:\+\d{1,3}|\(?0\d{1,5}\)?)(?:[ /-]\(?\d{2,}\)?)+"


def _phones(table: dict[str, Any]) -> Iterator[_Rule]:
    if "phones" not in table:
        return

    def edits(match: re.Match[str]) -> list[Edit]:
        parts = ((match.start() + part.start(), part[0]) for part in re.finditer(r"\d+|[/.-]", match[0]))
        return [(start, start + len(part), " ".join(part) if part.isdigit() else " ") for start, part in parts]

    before = r"(?<![\w.,/-])" if table.get("spaced", True) else r"(?<![\d.,/-])"
    pattern = f"{table['phones']}|{_PHONE}" if table["phones"] else _PHONE
    yield _Rule(re.compile(rf"{before}(?=(?:[ ()/.+-]*\d){{7}})(?:{pattern})(?!\d|[.,/:-]\d)"), edits)


_COUNT = r"(?<![\w.,/:+(-])(?<!\d[ \u00a0\u202f])(?P<n>\d{1,3}(?:[. \u00a0\u202f]?\d{3})?)"


def _genders(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    """Numbers that agree with a noun; those that a voice reads rightly stay."""
    if genders := table.get("gender"):

        def edits(match: re.Match[str]) -> list[Edit]:
            said = _agreed(table, language, match["n"], match["noun"], match.string[: match.start()])
            return [(*match.span("n"), said)] if said != match["n"] else []

        nouns = "|".join(each["nouns"] for each in genders)
        yield _Rule(re.compile(rf"{_COUNT}(?= (?P<noun>{nouns})\b)"), edits)


def _agreed(table: dict[str, Any], language: str, number: str, noun: str, before: str) -> str:
    """Number in words if they depend on the noun after it, or on what stands before both."""
    digits = re.sub(r"[. \u00a0\u202f](?=\d{3}(?!\d))", "", number)
    for each in table.get("gender", ()) if digits.isdecimal() and len(digits) <= 6 else ():
        if re.match(rf"(?:{each['nouns']})\b", noun) and (
            "before" not in each or re.search(rf"\b(?:{each['before']}) \Z", before)
        ):
            said = plain = _counted(digits, language, "cardinal")
            for end, other in each["ends"].items():
                said = re.sub(end, other, said)
            return said if said != plain else number
    return number


def _numbers(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    """Signs that a voice leaves out, and numbers that it reads in parts."""
    if minus := table.get("minus"):
        before, gap = (r"(?<![^\s(])(?<!\d\s)", " ") if table.get("spaced", True) else (r"(?<![\dA-Za-z])", "")
        yield _Rule(re.compile(rf"{before}[-−](?=[\d{_PARTS}])"), lambda match: [(*match.span(), minus + gap)])
    if joined := table.get("joined"):
        pattern = rf"(?<![\w.,+(-])(?<!\d )\d{{1,{joined}}}(?:[ \u00a0\u202f]\d{{3}})+(?!\w| \d|-\d)"
        yield _Rule(re.compile(pattern), lambda match: [(*match.span(), _whole(match[0], language))])
    if language == "cmn":

        def by_myriads(match: re.Match[str]) -> list[Edit]:
            said = _whole(match[0], language)
            return [(*match.span(), said)] if said != match[0] else []

        yield _Rule(re.compile(r"(?<![A-Za-z0-9.,:-])(?:\d{5,}|\d{1,3}(?:,\d{3})+)(?![\d.:-])"), by_myriads)


def _whole(number: str, language: str) -> str:
    """Number as its voice can read it: without spaces; in Chinese by ten thousands.

    Examples
    --------
    >>> _whole("1 250 000", "ru"), _whole("57,050", "cmn"), _whole("3.5", "cmn")
    ('1250000', '5万7050', '3.5')
    """
    if language != "cmn":
        return re.sub(r"\s", "", number)
    digits = number.replace(",", "")
    if not re.fullmatch(r"\d{5,12}", digits):
        return number
    many, rest = divmod(int(digits), 10_000)
    above = f"{_whole(str(many // 10_000), language)}亿" if many >= 10_000 else ""
    myriads = f"{many % 10_000}万" if many % 10_000 else ""
    return f"{above}{myriads}{'零' if 0 < rest < 1000 else ''}{rest or ''}"


def _edges(table: dict[str, Any]) -> tuple[str, str]:
    """Patterns of what stands before a number and after a word."""
    if table.get("spaced", True):
        return r"(?<![\w.,/])", r"(?!\w|[.,]\d)" + (r"(?!['’]\w)" if table.get("elides") else "")
    return r"(?<![\d.,/])", r"(?<![A-Za-z](?=[A-Za-z²³]))"


def _number(language: str) -> str:
    """Pattern of a number; in some languages a space parts its thousands."""
    return _SPACED_NUMBER if language in ("de", "es", "fr", "pt", "ru") else _NUMBER


def _alone(table: dict[str, Any]) -> str:
    """Pattern with a group that matches where the unit of any number has the form of one."""
    return f"(?:(?P<one>{table['one_after']})|)" if "one_after" in table else "(?P<one>(?!))?"


def _any_of(keys: dict[str, str]) -> str:
    return "|".join(re.escape(key) for key in sorted(keys, key=len, reverse=True))


def _prices(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    currencies, spaced = table.get("currencies", {}), table.get("spaced", True)
    if not currencies:
        return
    scale = f"(?P<scale>{table['scales']})" if "scales" in table else "(?P<scale>(?!))"
    short, of, to = table.get("short_scales", {"": ""}), table.get("of", ""), table.get("to", "–")
    number = _number(language)
    symbol, (edge, end) = f"(?P<symbol>{_any_of(currencies)})", _edges(table)
    edge += _alone(table)
    form = partial(_form_at, language)

    def amount(match: re.Match[str]) -> str:
        number, symbol = match["n"], match["symbol"]
        cents = _CENTS.fullmatch(number)
        if cents and cents[1] in ("0", "٠") and symbol in table.get("cents", {}):
            return f"{int(cents[2])} {_form(table['cents'][symbol], str(int(cents[2])), language)}"
        whole = cents[1] if cents else number
        if language == "cmn" or "joined" in table:
            whole = _whole(whole, language)
        unit = form(match, currencies[symbol], whole)
        whole = _agreed(table, language, whole, unit, match.string[: match.start()])
        if cents and int(cents[2]):
            parts = str(int(cents[2]))
            if len(parts) == 1 and symbol in table.get("cents", {}):
                parts += f" {_form(table['cents'][symbol], parts, language)}"
            return str(table["price"].format(whole=whole, unit=unit, cents=parts))
        return f"{whole} {unit}" if spaced else f"{whole}{unit}"

    def before(match: re.Match[str]) -> list[Edit]:
        if match.end("symbol") < match.start("n") and _NUMBER_BEFORE.search(
            match.string, max(match.start() - 2, 0), match.start()
        ):
            return []  # 5 € 50
        many = form(match, currencies[match["symbol"]], "5")
        for group, said in (("scale", match["scale"]), ("short", short.get(match["short"])), ("to", match["to"])):
            if said:
                gap = " " if group == "short" else ""
                said += f" {of}" if group == "scale" and of and said != "mil" else ""
                said = to + said[1:] if group == "to" else said
                return [(*match.span("symbol"), ""), (*match.span(group), f"{gap}{said} {many}")]
        return [(*match.span(), amount(match))]

    def after(match: re.Match[str]) -> list[Edit]:
        if match["scale"]:
            joint = f"{of} " if of and not match["of"] and match["scale"] != "mil" else ""
            return [(*match.span("symbol"), joint + form(match, currencies[match["symbol"]], "5"))]
        return [(*match.span(), amount(match))]

    yield _Rule(
        re.compile(rf"{edge}{symbol}{_GAP}{number}(?:[ -]{scale}|{_TO}|(?P<short>{_any_of(short)}))?{end}"), before
    )
    yield _Rule(re.compile(rf"{edge}{number}(?:{_GAP}{scale}(?P<of> {of})?)?{_GAP}{symbol}{end}"), after)


def _fractions(table: dict[str, Any]) -> Iterator[_Rule]:
    if fractions := table.get("fractions", {}):
        pattern = re.compile(rf"(?<![\d/.,])(?<!\d )(?:{_any_of(fractions)})(?![\d/])")
        yield _Rule(pattern, lambda match: [(*match.span(), fractions[match[0]])])


_MIXED = rf"\d+(?: ?[{_PARTS}]| \d/\d)"


def _mixed_units(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    """Fractions that are said after the unit of the whole number."""
    if not table.get("mixed", {}).get("last"):
        return
    mixed, units = table["mixed"], table["units"] | table["currencies"]
    plain = {sign: digits for digits, sign in _SIGNS.items()}

    def edits(match: re.Match[str]) -> list[Edit]:
        part, one = plain.get(match["part"], match["part"]), units[match["x"]].partition("|")[0]
        unit = _form(units[match["x"]], match["n"], language)
        whole = _agreed(table, language, match["n"], unit, match.string[: match.start()])
        said = mixed.get(f"{part} {one}") or mixed.get(part)
        unit, rate, per = unit.partition(mixed.get("rate", "\n"))
        return [(*match.span(), f"{whole} {unit} {said}{rate}{per}" + _full_stop(match, "x"))] if said else []

    parts = f" ?(?P<part>{_any_of(plain)}|(?<= ){_any_of(_SIGNS)})"
    edge, end = _edges(table)
    yield _Rule(re.compile(rf"{edge}(?P<n>\d+){parts}{_GAP}(?P<x>{_any_of(units)}){end}{_sentence(table)}"), edits)


def _in_mixed(number: str, table: dict[str, Any]) -> str:
    """Number with the words of its fraction, if it has one."""
    parted = re.fullmatch(rf"(\d+) ?([{_PARTS}]|\d/\d)", number)
    plain = {sign: digits for digits, sign in _SIGNS.items()}
    said = parted and table["mixed"].get(plain.get(parted[2], parted[2]))
    return f"{parted[1]} {said}" if parted and said else number


def _units(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    units, spaced, share = table.get("units", {}), table.get("spaced", True), table.get("share")
    fractions = table["fractions"]
    if not units:
        return

    def edits(match: re.Match[str]) -> list[Edit]:
        number = match["n"]
        said = " " if spaced and match.end("n") == match.start("x") else ""
        if re.fullmatch(_MIXED, number):
            number = re.sub(r"(?<=\d)\D.*", ".5", number)
        elif number in fractions:
            said += f"{share} " if share and number not in ("1/2", "½") else ""
            number = "0.5"
        unit = _form_at(language, match, units[match["x"]], number)
        if table.get("unit_first") and match["n"] not in fractions:
            return [(*match.span("n"), unit), (*match.span("x"), said + _in_mixed(match["n"], table))]
        agreed = _agreed(table, language, number, unit, match.string[: match.start()])
        counted = [(*match.span("n"), agreed)] if agreed != number and match["n"] == number else []
        return [*counted, (*match.span("x"), said + unit + _full_stop(match))]

    number, (edge, end) = _number(language), _edges(table)
    if fractions:
        number = number.replace("(?>", rf"(?>{_MIXED}|{_any_of(fractions)}|", 1)
    pattern = rf"{edge}{_alone(table)}{number}{_GAP}(?P<x>{_any_of(units)}){end}{_sentence(table)}"
    yield _Rule(re.compile(pattern), edits)


def _words(table: dict[str, Any]) -> Iterator[_Rule]:
    words, (edge, end) = table.get("words", {}), _edges(table)
    if words:
        pattern = re.compile(f"{edge}(?:{_any_of(words)}){end}{_sentence(table)}")
        yield _Rule(pattern, lambda match: [(*match.span(), words[match[0]] + _full_stop(match))])


def _full_stop(match: re.Match[str], group: str | int = 0) -> str:
    """Stop of a sentence that ends with an abbreviation's."""
    return "." if match[group].endswith(".") and match["sentence"] is not None else ""


def _sentence(table: dict[str, Any]) -> str:
    """Pattern with a group that matches where a text ends or another sentence begins."""
    return rf"(?=(?P<sentence>\s*\Z|\s+(?:{table.get('starters', '(?!)')})\b)?)"


def _listed(table: dict[str, Any], language: str) -> Iterator[_Rule]:
    for each in table.get("rules", ()):
        pattern = re.compile(each["find"] + _sentence(table))
        group = "x" if "x" in pattern.groupindex else 0

        def edits(match: re.Match[str], each: dict[str, Any] = each, group: str | int = group) -> list[Edit]:
            kind = each.get("form", "")
            if kind in _COUNTED and not (int(match["n"]) if match["n"].isdigit() else _ROMAN.fullmatch(match["n"])):
                return []  # no number has such an ordinal
            number = _FORMS[kind](match["n"], language) if kind else ""
            return [(*match.span(group), each["say"].format(number, *match.groups()) + _full_stop(match, group))]

        yield _Rule(pattern, edits)


def _form_at(language: str, match: re.Match[str], forms: str, number: str) -> str:
    """Form of a word after a number; where :func:`_alone` matches, that after one."""
    return _form(forms, number if match["one"] is None else "1", language)


def _form(forms: str, number: str, language: str) -> str:
    """Form of a word after a number: the only one; one or other; one, few or many; one, few, many or part."""
    one, *more = forms.split("|")
    if not more:
        return one
    whole, _, part = re.sub(r"[.,\s](?=\d{3}(?!\d))", "", number).replace(",", ".").partition(".")
    if len(more) == 1:
        if part:
            return one if (language in ("fr", "pt") and whole in ("0", "1")) or number == "0.5" else more[0]
        return one if whole == "1" or (language in ("fr", "pt") and whole == "0") else more[0]
    if part:
        return more[2] if len(more) == 3 else more[0]  # 2,5 километра
    last_two = int(whole[-2:])
    if whole == "1" or (language == "ru" and last_two % 10 == 1 and last_two != 11):
        return one
    return more[0] if 2 <= last_two % 10 <= 4 and not 12 <= last_two <= 14 else more[1]


def _counted(number: str, language: str, kind: str) -> str:
    """Number, also a Roman one, in words, by num2words (LGPL-2.1)."""
    num2words = needed("num2words", "num2words", "voice")
    return str(num2words.num2words(int(number if number.isdigit() else _roman(number)), lang=language, to=kind))


def _year(number: str, language: str) -> str:
    return _counted(number, language, "year")


def _decade(number: str, language: str) -> str:
    words = _year(number, language)
    return f"{words[:-1]}ies" if words.endswith("y") else f"{words}s"


def _ordinal(number: str, language: str) -> str:
    return _counted(number, language, "ordinal")


_ENDINGS = {
    "feminine": {"o": "a", "ый": "ая", "ой": "ая", "ий": "ья"}, "neuter": {"ый": "ое", "ой": "ое", "ий": "ье"},
    "short": {"primero": "primer", "tercero": "tercer"},
    "plural": {"ый": "ые", "ой": "ые", "ий": "ьи"},
    "genitive": {"ый": "ого", "ой": "ого", "ий": "ьего", "y": "ego", "i": "iego"},
    "prepositional": {"ый": "ом", "ой": "ом", "ий": "ьем", "y": "ym", "i": "im"},
}  # fmt: skip
"""What the ends of ordinals become, in all languages that ask for it."""


def _declined(number: str, language: str, kind: str) -> str:
    endings = _ENDINGS[kind]
    return re.sub(rf"(?:{'|'.join(endings)})\b", lambda match: endings[match[0]], _ordinal(number, language))


def _roman(number: str, _: str = "") -> str:
    values = [{"I": 1, "V": 5, "X": 10}[letter] for letter in number]
    return str(sum(-value if value < max(values[index:]) else value for index, value in enumerate(values)))


_ROMAN = re.compile("X{0,3}(?:IX|IV|V?I{0,3})")
_COUNTED = ("ordinal", *_ENDINGS)
_FORMS: dict[str, Callable[[str, str], str]] = {
    "year": _year, "decade": _decade, "ordinal": _ordinal, "roman": _roman,
    **{kind: partial(_declined, kind=kind) for kind in _ENDINGS},
}  # fmt: skip
