# ruff: noqa: E501
"""Small timing files in the shapes that public tools write, each with what must be read from it.

All files are written here; the words and times are our own. ``source`` names the tool and where its shape is described.
"""

import json
from dataclasses import dataclass, field, replace

Labels = list[tuple[str, float, float]]


@dataclass(frozen=True)
class Case:
    """A file, and its phones or words, or a part of the error."""

    name: str
    source: str
    data: str | bytes
    expected: Labels | str
    """(label, start in s, end in s) without silences, or a pattern of the error."""
    ending: str = ""
    options: dict[str, str] = field(default_factory=dict)
    language: str = ""
    remark: str = ""
    """Part of a remark; empty where nothing may look wrong."""


def timed(
    rows: Labels, label: str, start: str = "start", end: str = "end", scale: float = 1
) -> list[dict[str, object]]:
    return [{label: text, start: round(a * scale, 4), end: round(b * scale, 4)} for text, a, b in rows]


def text(*rows: object) -> str:
    return "".join(f"{row}\n" for row in rows)


def lab(rows: Labels, between: str = " ", scale: float = 1e7, form: str = "{:.0f}") -> str:
    return text(*(between.join([form.format(a * scale), form.format(b * scale), label]) for label, a, b in rows))


FR: Labels = [("bonjour", 0.1, 0.5), ("mes", 0.5, 0.7), ("amis", 0.7, 1.2)]
EN: Labels = [("paper", 0.1, 0.5), ("boats", 0.5, 0.9), ("float", 1.0, 1.4)]
IPA: Labels = [("b", 0.0, 0.08), ("oʊ", 0.08, 0.24), ("t", 0.24, 0.31), ("s", 0.31, 0.42)]
ARPA: Labels = [("B", 0.0, 0.08), ("OW1", 0.08, 0.24), ("T", 0.24, 0.31), ("S", 0.31, 0.42)]
VISEMES = [(0.0, 0), (0.05, 21), (0.13, 8), (0.24, 19), (0.31, 15), (0.42, 0)]
SEEN: Labels = [("p", 0.05, 0.13), ("o", 0.13, 0.24), ("d", 0.24, 0.31), ("s", 0.31, 0.42)]
WHISPER = {"text": "bonjour mes amis", "language": "fr",
           "segments": [{"id": 0, "start": 0.1, "end": 1.2, "text": "", "words": timed(FR, "word")}]}  # fmt: skip


def azure(offset: str, viseme: str, scale: float, *, whole: bool = False) -> list[dict[str, object]]:
    return [{offset: round(at * scale) if whole else at * scale + 0.25, viseme: number} for at, number in VISEMES]


def grid(tier: str, rows: Labels) -> str:
    intervals = "".join(f'{a}\n{b}\n"{label}"\n' for label, a, b in rows)
    head = 'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n2\n<exists>\n1\n"IntervalTier"\n'
    return f'{head}"{tier}"\n0\n2\n{len(rows)}\n{intervals}'


MS = 1000.0
PHRASE = r"expected one word"
UNIT = r"seconds or milliseconds.*columns='unit="
SHIFTED: Labels = [(label, a + 0.00025, b + 0.00025) for label, a, b in SEEN]
# fmt: off
RECOGNIZERS = (
    Case("whisper", "openai/whisper: transcribe(word_timestamps=True), README", json.dumps(WHISPER), FR, language="fr"),
    Case("whisper-timestamped", "linto-ai/whisper-timestamped: README, example output",
         json.dumps({"language": "French", "segments": [{"words": [{"text": row["word"], **row, "confidence": 0.9}
                     for row in timed(FR, "word")]}]}), FR, language="French"),
    Case("whisperx", "m-bain/whisperX: alignment output", json.dumps(WHISPER | {"word_segments": timed(FR, "word")}),
         FR, language="fr"),
    Case("faster-whisper", "SYSTRAN/faster-whisper: TranscriptionInfo beside the segments",
         json.dumps({"info": {"language": "fr", "language_probability": 0.98},
                     "segments": [{"words": timed(FR, "word")}]}), FR, language="fr"),
    Case("stable-ts", "jianfch/stable-ts: save_as_json", json.dumps({**WHISPER, "ori_dict": WHISPER}), FR,
         language="fr"),
    Case("whisper without a language", "openai/whisper", json.dumps({"segments": WHISPER["segments"]}), FR),
    Case("whisper, language auto", "ahmetoner/whisper-asr-webservice: README",
         json.dumps(WHISPER | {"language": "auto"}), FR),
    Case("whisper, a word of no length", "openai/whisper, issue tracker",
         json.dumps({"segments": [{"words": [*timed(FR, "word"), {"word": "ah", "start": 1.2, "end": 1.2}]}]}), FR,
         remark="1 row was dropped.*'ah' at 1.200 s"),
    Case("whisper phrases", "openai/whisper: without word_timestamps",
         json.dumps({"language": "fr", "segments": [{"start": 0, "end": 1.2, "text": "bonjour mes amis"}]}),
         "contains no word with times.*word_timestamps=True"),
    Case("openai verbose_json", "OpenAI API reference: CreateTranscriptionResponseVerboseJson",
         json.dumps({"task": "transcribe", "language": "french", "duration": 1.2, "words": timed(FR, "word")}), FR,
         language="french"),
    Case("openai verbose_json in English", "the same", json.dumps({"language": "english", "words": timed(EN, "word")}),
         EN, language="english"),
    Case("whisper.cpp", "ggml-org/whisper.cpp: -ojf", json.dumps({
        "params": {"language": "auto"}, "result": {"language": "fr"}, "transcription": [{"tokens": [
            {"text": f" {label}", "offsets": {"from": round(a * MS), "to": round(b * MS)}} for label, a, b in FR]}]}),
         FR, language="fr"),
    Case("transformers", "huggingface/transformers: automatic-speech-recognition pipeline",
         json.dumps({"text": "", "chunks": [{"text": f" {label}", "timestamp": [a, b]} for label, a, b in FR]}), FR),
    Case("vosk", "alphacep/vosk-api: SetWords", json.dumps({"result": timed(EN, "word"), "text": ""}), EN),
    Case("deepgram", "Deepgram documentation: language detection", json.dumps({"results": {"channels": [
        {"detected_language": "fr", "alternatives": [{"words": timed(FR, "word")}]}]}}), FR, language="fr"),
    Case("assemblyai", "AssemblyAI API reference: transcript", json.dumps({"language_code": "fr", "words": [
        {**row, "confidence": 0.9} for row in timed(FR, "text", scale=MS)]}), FR, language="fr"),
    Case("aws transcribe", "Amazon Transcribe developer guide: output", json.dumps({"results": {
        "language_code": "fr-FR", "items": [{"type": "pronunciation", "start_time": str(a), "end_time": str(b),
                                             "alternatives": [{"content": label}]} for label, a, b in FR]
        + [{"type": "punctuation", "alternatives": [{"content": "."}]}]}}), FR, language="fr-FR"),
    Case("google 1", "Cloud Speech-to-Text 1: RecognizeResponse", json.dumps({"results": [{"languageCode": "fr-fr",
         "alternatives": [{"words": [{"startTime": f"{a}s", "endTime": f"{b}s", "word": label} for label, a, b in FR]}]
         }]}), FR, language="fr-fr"),
    Case("google 2", "Cloud Speech-to-Text 2: RecognizeResponse", json.dumps({"results": [{"languageCode": "fr-FR",
         "alternatives": [{"words": [{"startOffset": f"{a}s", "endOffset": f"{b}s", "word": label}
                                     for label, a, b in FR]}]}]}), FR, language="fr-FR"),
    Case("elevenlabs scribe", "ElevenLabs API reference: speech to text", json.dumps({"language_code": "fra", "words": [
        {**row, "type": "word", "logprob": 0.0} for row in timed(FR, "text")]}), FR, language="fra"),
    Case("soniox", "Soniox documentation: tokens", json.dumps({"tokens": [
        {"text": f" {label}", "start_ms": a * MS, "end_ms": b * MS, "language": "fr"} for label, a, b in FR]}), FR,
         language="fr"),
    Case("gladia phrases", "Gladia documentation: result", json.dumps({"result": {"transcription": {"languages": ["fr"],
         "utterances": [{"text": "bonjour mes amis", "start": 0.1, "end": 1.2}]}}}), "contains no word with times"),
    Case("gladia words", "Gladia documentation: result", json.dumps({"result": {"transcription": {"languages": ["fr"],
         "utterances": [{"text": "bonjour mes amis", "start": 0.1, "end": 1.2, "words": timed(FR, "word")}]}}}), FR,
         language="fr"),
    Case("deepgram of several languages", "Deepgram documentation: multilingual", json.dumps({"results": {"channels": [
        {"alternatives": [{"languages": ["fr"], "words": [{**row, "language": "fr"} for row in timed(FR, "word")]}]}]}}),
         FR, language="fr"),
    Case("deepgram, words of two languages", "the same", json.dumps({"results": {"channels": [{"alternatives": [{"words": [
        {**row, "language": language} for row, language in zip(timed(FR, "word"), ("en", "fr", "fr"), strict=True)
        ]}]}]}}), FR, language="fr"),
    Case("aws of several languages", "Amazon Transcribe developer guide: IdentifyMultipleLanguages", json.dumps({"results": {
        "language_codes": [{"language_code": "fr-FR", "duration_in_seconds": 3.2}], "items": [
            {"type": "pronunciation", "start_time": str(a), "end_time": str(b), "alternatives": [{"content": label}]}
            for label, a, b in FR]}}), FR, language="fr-FR"),
    Case("azure batch transcription", "Azure Speech: batch transcription results", json.dumps({"recognizedPhrases": [{
        "locale": "fr-FR", "offsetInTicks": 1e6, "nBest": [{"words": [
            {"word": label, "offset": f"PT{a}S", "offsetInTicks": a * 1e7, "durationInTicks": (b - a) * 1e7}
            for label, a, b in FR]}]}]}), FR, language="fr-FR"),
    Case("azure sdk, detailed", "Azure Speech SDK: request_word_level_timestamps", json.dumps({"Id": "1", "Offset": 1e6,
         "Duration": 11e6, "PrimaryLanguage": {"Language": "fr-FR"}, "NBest": [{"Words": [
             {"Word": label, "Offset": round(a * 1e7), "Duration": round((b - a) * 1e7)} for label, a, b in FR]}]}), FR,
         language="fr-FR"),
    Case("azure fast transcription", "Azure Speech: fast transcription API", json.dumps({"phrases": [{"locale": "fr-FR",
         "words": [{"text": label, "offsetMilliseconds": a * MS, "durationMilliseconds": (b - a) * MS}
                   for label, a, b in FR]}]}), FR, language="fr-FR"),
    Case("rev", "Rev AI documentation: transcript", json.dumps({"monologues": [{"elements": [
        {"type": "text", "value": label, "ts": a, "end_ts": b} for label, a, b in FR]}]}), FR),
    Case("speechmatics", "Speechmatics documentation: json-v2", json.dumps({"metadata": {"transcription_config": {
        "language": "fr"}}, "results": [{"type": "word", "start_time": a, "end_time": b, "alternatives": [
            {"content": label, "language": "fr"}]} for label, a, b in FR]}), FR, language="fr"),
    Case("watson", "IBM Watson: timestamps=true", json.dumps({"results": [{"alternatives": [{"timestamps": FR}]}]}), FR),
    Case("kokoro-fastapi", "remsky/Kokoro-FastAPI: captioned speech",
         json.dumps({"timestamps": timed(EN, "word", "start_time", "end_time")}), EN),
    Case("edge-tts", "rany2/edge-tts: WordBoundary", text(*(json.dumps(
        {"type": "WordBoundary", "offset": a * 1e7, "duration": (b - a) * 1e7, "text": label}) for label, a, b in EN)),
         EN),
    Case("azure word boundaries", "Azure Speech SDK for Python, as programs store them", json.dumps([
        {"audioOffset": a * 1e7, "duration": (b - a) * 1e7, "text": label, "boundaryType": "WordBoundary"}
        for label, a, b in EN]), EN),
    Case("azure word boundaries in JavaScript", "Azure Speech SDK for JavaScript: JSON.stringify(event)", json.dumps([
        {"privAudioOffset": a * 1e7, "privDuration": (b - a) * 1e7, "privText": label, "privBoundaryType": kind}
        for label, a, b, kind in [*((*row, "WordBoundary") for row in EN), ("a b", 0, 1, "SentenceBoundary")]]), EN),
    Case("edge-tts, starts of another name", "attacks", json.dumps([
        {"type": "WordBoundary", "begin_at": a * 1e7, "duration": (b - a) * 1e7, "text": label} for label, a, b in EN]),
         "expected a known format"),
    Case("elevenlabs by a socket", "ElevenLabs API reference: WebSocket", json.dumps({"audio": "", "normalizedAlignment": {
        "chars": list("a b"), "charStartTimesMs": [0, 100, 200], "charsDurationsMs": [100, 100, 300]}}),
         [("a", 0.0, 0.1), ("b", 0.2, 0.5)]),
    Case("speechify", "Speechify API reference: speech marks, with places of characters", json.dumps({"speech_marks": {
        "chunks": [{"type": "word", "start": n, "end": n + 1, "start_time": 1000 * a, "end_time": 1000 * b, "value": label}
                   for n, (label, a, b) in enumerate(EN)]}}), EN, options={"columns": "unit=ms"}),
    # with the structure of usnistgov/SCTK, lvc_hypc.ctm
    Case("ctm, alternatives", "usnistgov/SCTK: doc/infmts.htm", text(
        f"talk B {EN[0][1]} {EN[0][2] - EN[0][1]:.2f} {EN[0][0]} 0.9", "talk B * * <ALT_BEGIN> 0.06",
        f"talk B {EN[1][1]} {EN[1][2] - EN[1][1]:.2f} {EN[1][0]} 0.8", "talk B * * <ALT> 0.33",
        f"talk B {EN[1][1]} 0.20 AT 0.8", "talk B * * <ALT_END> 0.26",
        *(f"talk B {a} {b - a:.2f} {label} 0.9" for label, a, b in EN[2:])), EN, ".ctm",
        remark="1 choices of alternatives, of which the first is read"),
    Case("ctm, two channels", "usnistgov/SCTK: lvc_hyp.ctm", text(
        "talk A 0.0 9.0 no", *(f"talk B {a} {b - a:.2f} {label}" for label, a, b in EN)), EN, ".ctm", {"tier": "talk B"}),
    Case("ctm", "kaldi-asr/kaldi: ctm", text(*(f"talk 1 {a} {b - a:.2f} {label}" for label, a, b in EN)), EN, ".ctm"),
    Case("gentle", "lowerquality/gentle: README", json.dumps({"words": [{"case": "success", **row}
                                                                  for row in timed(EN, "word")]}), EN),
    Case("aeneas phrases", "readbeyond/aeneas: JSON sync map", json.dumps({"fragments": [
        {"begin": "0.0", "end": "1.4", "lines": ["paper boats float"], "children": []}]}), "align word by word"),
)  # fmt: skip
CUES = [f"00:00:{a:06.3f} --> 00:00:{b:06.3f}\n{label}\n" for label, a, b in FR]
ROLLING = """WEBVTT
Kind: captions

00:00:00.100 --> 00:00:00.900 align:start position:0%
\x20
des<00:00:00.400><c> amis</c>

00:00:00.900 --> 00:00:00.910 align:start position:0%
des amis
\x20

00:00:00.910 --> 00:00:01.400 align:start position:0%
des amis
oui

00:00:01.400 --> 00:00:01.410 align:start position:0%
oui
\x20
"""
MARKED = [
    f"00:00:{a:06.3f} --> 00:00:{b:06.3f}\n{' '.join(row[0] for row in FR).replace(label, f'<font color=#00ff00>{label}</font>')}\n"
    for label, a, b in FR
]  # fmt: skip
SUBTITLES = (
    Case("srt of stable-ts", "jianfch/stable-ts: to_srt_vtt: the spoken word is coloured", text("WEBVTT", "", *MARKED), FR, ".vtt"),
    Case("srt with a coloured word", "players", text("WEBVTT", "", *[CUES[0].replace(FR[0][0], "de nos amis")] * 4, MARKED[0]),
         PHRASE, ".vtt"),
    Case("vtt of youtube that rolls up", "yt-dlp/yt-dlp: --write-auto-subs: a line of a blank, and one of one word", ROLLING,
         [("des", 0.1, 0.4), ("amis", 0.4, 0.9), ("oui", 0.91, 1.4)], ".vtt"),
    Case("vtt of youtube", "yt-dlp/yt-dlp: --write-auto-subs; W3C WebVTT",
         text("WEBVTT", "Kind: captions", "Language: fr", "", *CUES), FR, ".vtt", language="fr"),
    Case("vtt", "W3C WebVTT", text("WEBVTT", "", *CUES), FR, ".vtt"),
    Case("vtt with a language in quotes", "players", text("WEBVTT", 'X-LANGUAGE="fr"', "", *CUES), FR, ".vtt",
         language="fr"),
    Case("vtt with spans", "W3C WebVTT: language spans", text("WEBVTT", "", *(
        cue.replace(label, f"<lang fr>{label}</lang>") for cue, (label, _, _) in zip(CUES, FR, strict=True))), FR, ".vtt",
         language="fr"),
    Case("srt", "SubRip; edge-tts", text(*(f"{n}\n{cue.replace('.', ',')}" for n, cue in enumerate(CUES, 1))), FR,
         ".srt"),
    Case("srt of phrases", "SubRip", text("1", "00:00:00,000 --> 00:00:01,000", "bonjour mes amis"), PHRASE, ".srt"),
)  # fmt: skip
LABELS = (
    Case("audacity phones", "Audacity manual: importing labels", lab(IPA, "\t", 1, "{:.6f}"), IPA, ".txt"),
    Case("audacity words", "the same", lab(EN, "\t", 1, "{:.6f}"), EN, ".txt"),
    Case("audacity with spectral ranges", "the same", text(*(f"{row}\n\\\t100.0\t2000.0" for row in lab(
        EN, "\t", 1, "{:.6f}").splitlines())), EN, ".txt"),
    Case("audacity phrases", "readbeyond/aeneas: .aud",
         "0.000000\t1.500000\tpaper boats float\n1.500000\t3.000000\tmy good friend\n", PHRASE, ".aud"),
    Case("audacity with decimal commas", "Audacity, in a locale that writes so",
         lab(IPA, "\t", 1, "{:.6f}").replace(".", ","), IPA, ".txt"),
    Case("audacity, an empty label", "Audacity manual", "0.0\t0.1\t\n" + lab(
        [("paper", 0.1, 0.5), ("boats", 0.5, 0.9)], "\t", 1, "{:.6f}"), EN[:2], ".txt"),
    Case("audacity points", "Audacity manual: point labels",
         text("0.0\t0.0\tb", "0.08\t0.08\toʊ", "0.24\t0.24\tt"),
         [("b", 0, 0.08), ("oʊ", 0.08, 0.24), ("t", 0.24, 0.34)], ".txt"),
    Case("htk", "HTK Book 3.4, 6.2.1", lab(IPA), IPA, ".lab"),
    Case("htk with scores", "HTK Book: HVite -o N", lab(IPA).replace("\n", " -52.25\n"), IPA, ".lab"),
    Case("htk words with scores", "HTK Book: HVite", lab(EN).replace("\n", " -52.25\n"), EN, ".lab"),
    Case("htk phones with words", "HTK Book: HVite -m",
         "0 800000 B -9.5 BOATS\n800000 2400000 OW1 -8.5\n2400000 3100000 T -1.5\n", [
             ("b", 0, 0.08), ("oʊ", 0.08, 0.24), ("t", 0.24, 0.31)], ".lab"),
    Case("htk states", "HTK Book: HVite -f", text(*(f"{n * 300000} {(n + 1) * 300000} {label}[{2 + n % 3}]"
         for n, label in enumerate(["B", "B", "B", "OW", "OW", "OW", "B", "B", "B"]))),
         [("b", 0, 0.09), ("oʊ", 0.09, 0.18), ("b", 0.18, 0.27)], ".lab"),
    Case("htk states of one phone twice", "the same", text(*(f"{n * 300000} {(n + 1) * 300000} B[{2 + n % 3}]"
         for n in range(6))), [("b", 0, 0.09), ("b", 0.09, 0.18)], ".lab"),
    Case("hts states in context", "r9y9/nnmnkwii: state labels of HTS", text(*(
        f"{n * 300000} {(n + 1) * 300000} x^sil-{label}+{after}=x@1_1/A:0_0[{2 + n % 5}]"
        for n, (label, after) in enumerate([("b", "ow")] * 5 + [("ow", "t")] * 5))),
         [("b", 0, 0.15), ("oʊ", 0.15, 0.3)], ".lab"),
    Case("hts phones in context", "CSTR-Edinburgh/merlin", text("0 800000 x^sil-b+ow=t@1",
         "800000 2400000 sil^b-ow+t=s@1", "2400000 3100000 b^ow-t+s=x@1"),
         [("b", 0, 0.08), ("oʊ", 0.08, 0.24), ("t", 0.24, 0.31)], ".lab"),
    Case("lab in samples", "julius-speech/segmentation-kit", "0 1280 b\n1280 3840 oʊ\n", "are they samples", ".lab"),
    Case("lab in samples, declared", "the same", "0 1280 b\n1280 3840 oʊ\n", IPA[:2], ".lab", {"columns": "hz=16000"}),
    Case("xlabel", "festvox: lab/*.lab", text("#", *(f"{b:.5f} 125 {label}" for label, _, b in IPA)), IPA, ".lab"),
    Case("timit", "LDC93S1: PHN", lab([("h#", 0, 0.1), ("sh", 0.1, 0.2), ("iy", 0.2, 0.4)], scale=16000),
         [("ʃ", 0.1, 0.2), ("i", 0.2, 0.4)], ".phn"),
    Case("pho", "numediart/MBROLA: .pho", "_ 100\nb 80 50 120\noU 160\nt 70\n",
         [("b", 0.1, 0.18), ("oʊ", 0.18, 0.34), ("t", 0.34, 0.41)], ".pho"),
    Case("pho with decimal commas", "numediart/MBROLA", "_ 100\nb 80 0,5 120 50,5 110\noU 160\n",
         [("b", 0.1, 0.18), ("oʊ", 0.18, 0.34)], ".pho"),
    Case("textgrid", "praat/praat: TextGrid", grid("phones", IPA), IPA, ".TextGrid"),
    Case("textgrid of words", "praat/praat", grid("words", EN), EN, ".TextGrid"),
    Case("textgrid with trigraphs", "Praat manual: phonetic symbols", grid("ipa", [
        ("\\sh", 0, 0.1), ("\\ef", 0.1, 0.2), ("t\\sh", 0.2, 0.3), ("\\as\\:f", 0.3, 0.4), ("\\ng", 0.4, 0.5)]),
         [("ʃ", 0, 0.1), ("ɛ", 0.1, 0.2), ("tʃ", 0.2, 0.3), ("ɑː", 0.3, 0.4), ("ŋ", 0.4, 0.5)], ".TextGrid"),
    Case("textgrid, silence alone", "praat/praat", grid("phones", [("", 0, 1), ("sil", 1, 2)]),
         "got 2 silences, expected phones or words", ".TextGrid"),
    Case("textgrid, an unknown label", "timmahrt/praatIO", grid("phones", [*ARPA, ("PT", 0.5, 0.6)]),
         [*IPA, ("PT", 0.5, 0.6)], ".TextGrid", remark="unknown phone 'PT' once, first at 0.500 s"),
    Case("mfa csv", "Montreal Forced Aligner: csv", text("Begin,End,Label,Type,Speaker", *(
        f"{a},{b},{label},phones,anna" for label, a, b in ARPA)), IPA, ".csv"),
)  # fmt: skip
SLOTS = "".join(
    f'<TIME_SLOT TIME_SLOT_ID="{n}{end}" TIME_VALUE="{row[end] * 1000:.0f}"/>'
    for n, row in enumerate(FR)
    for end in (1, 2)
)
ANNOTATIONS = "".join(
    f'<ANNOTATION><ALIGNABLE_ANNOTATION TIME_SLOT_REF1="{n}1" TIME_SLOT_REF2="{n}2"><ANNOTATION_VALUE>'
    f"{row[0]}</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>"
    for n, row in enumerate(FR)
)
NOTES = '<TIER TIER_ID="notes"><ANNOTATION><REF_ANNOTATION><ANNOTATION_VALUE>x</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION></TIER>'


def eaf(tiers: str, languages: str = "") -> str:
    order = f'<TIME_ORDER>{SLOTS}<TIME_SLOT TIME_SLOT_ID="none"/><TIME_SLOT TIME_SLOT_ID="other"/></TIME_ORDER>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<ANNOTATION_DOCUMENT>{order}{tiers}{languages}</ANNOTATION_DOCUMENT>'
    )


UNTIMED = ANNOTATIONS.replace('TIME_SLOT_REF2="02"', 'TIME_SLOT_REF2="none"')
SUBDIVIDED = "".join(
    f'<ANNOTATION><ALIGNABLE_ANNOTATION TIME_SLOT_REF1="{first}" TIME_SLOT_REF2="{last}"><ANNOTATION_VALUE>'
    f"{word}</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>"
    for first, last, word in (("01", "none", "un"), ("none", "other", "deux"), ("other", "02", "trois"))
)
STEP_S = (FR[0][2] - FR[0][1]) / 3
THREE = [(word, FR[0][1] + n * STEP_S, FR[0][1] + (n + 1) * STEP_S) for n, word in enumerate(("un", "deux", "trois"))]
PHRASES = (
    '<TIER TIER_ID="text"><ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="p" TIME_SLOT_REF1="01" TIME_SLOT_REF2="02">'
    "<ANNOTATION_VALUE>un deux trois</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION></TIER>"
)


def referring(tier: str, *rows: tuple[str, str, str, str]) -> str:
    """A tier of annotations: each its id, what it refers to, the one before, its label."""
    return f'<TIER TIER_ID="{tier}">' + "".join(
        f'<ANNOTATION><REF_ANNOTATION ANNOTATION_ID="{name}" ANNOTATION_REF="{parent}"'
        + (f' PREVIOUS_ANNOTATION="{before}"' if before else "")
        + f"><ANNOTATION_VALUE>{label}</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>"
        for name, parent, before, label in rows
    ) + "</TIER>"  # fmt: skip


WORDS_OF_PHRASE = (("c", "p", "b", "trois"), ("a", "p", "", "un"), ("b", "p", "a", "deux"))
COPIES = (("x", "a", "", "UN"), ("y", "b", "", "DEUX"), ("z", "c", "", "TROIS"))
CIRCLE = referring("notes", ("p", "z", "", "again"))
ELAN = (
    Case("elan", "EAF schema 3.0: LANG_REF", eaf(f'<TIER TIER_ID="words" LANG_REF="fra">{ANNOTATIONS}</TIER>{NOTES}'), FR,
         ".eaf", language="fra"),
    Case("elan, a locale", "EAF schema 2.7: DEFAULT_LOCALE", eaf(f'<TIER TIER_ID="A" DEFAULT_LOCALE="fr">{ANNOTATIONS}</TIER>'),
         FR, ".eaf", language="fr"),
    Case("elan, one language", "EAF schema 3.0", eaf(f'<TIER TIER_ID="A">{ANNOTATIONS}</TIER>', '<LANGUAGE LANG_ID="fra"/>'),
         FR, ".eaf", language="fra"),
    Case("elan, a slot without a time", "EAF schema 3.0", eaf(f'<TIER TIER_ID="words">{UNTIMED}</TIER>'), FR[1:], ".eaf",
         remark="1 annotations without times are left out"),
    # with the structure of dopefishh/pympi, test/sample_3.0.eaf
    Case("elan, a subdivided tier", "EAF schema 3.0: Time_Subdivision", eaf(f'<TIER TIER_ID="words">{SUBDIVIDED}</TIER>'),
         THREE, ".eaf", remark="2 boundaries without times are spread evenly"),
    # with the structure of dopefishh/pympi, test/sample_3.0.eaf
    Case("elan, a tier that refers", "EAF schema 3.0: Symbolic_Subdivision", eaf(referring("words", *WORDS_OF_PHRASE) + PHRASES),
         THREE, ".eaf", remark="share the times of those that they refer to evenly"),
    Case("elan, a tier that refers to such a tier", "EAF schema 3.0: Symbolic_Association; a circle",
         eaf(CIRCLE + referring("copies", *COPIES) + referring("words", *WORDS_OF_PHRASE) + PHRASES),
         [(word.upper(), *times_s) for word, *times_s in THREE], ".eaf", {"tier": "copies"},
         remark="share the times of those that they refer to evenly"),
    Case("elan, a tier of words, and notes on it", "EAF schema 3.0",
         eaf(PHRASES.replace("un deux trois", "bonjour") + referring("gloss", ("a", "p", "", "hello"))),
         [("bonjour", *FR[0][1:])], ".eaf"),
    Case("elan, two tiers", "EAF schema 3.0", eaf(f'<TIER TIER_ID="A">{ANNOTATIONS}</TIER><TIER TIER_ID="B">{ANNOTATIONS}</TIER>'),
         "name one with tier=NAME", ".eaf"),
    Case("elan, a tier", "EAF schema 3.0", eaf(f'<TIER TIER_ID="A">{ANNOTATIONS}</TIER><TIER TIER_ID="B">{ANNOTATIONS}</TIER>'),
         FR, ".eaf", {"tier": "B"}),
    Case("elan, phrases", "EAF schema 3.0", eaf(f'<TIER TIER_ID="A">{ANNOTATIONS.replace("mes", "mes amis")}</TIER>'),
         PHRASE.replace("expected one word", "expected one"), ".eaf"),
    Case("elan, entities", "attacks", eaf('<!ENTITY a "b">'), "got a document type or entities", ".eaf"),
)  # fmt: skip
READ_IN_MS, READ_IN_S = "read in ms, by its distances.*columns='unit=ticks'", "read in s, by its distances"
TOOLS = (
    Case("azure in ticks", "Azure Speech SDK: VisemeReceived", json.dumps(azure("audio_offset", "viseme_id", 1e7,
         whole=True)), SEEN),
    Case("azure, pascal case", "Azure Speech SDK for C#", text(*map(json.dumps, azure("AudioOffset", "VisemeId", 1e7,
         whole=True))), SEEN),
    Case("azure in ms", "asanchezyali/ai-avatar: visemes", json.dumps(azure("audio_offset", "viseme_id", MS)), SHIFTED,
         remark=READ_IN_MS),
    Case("azure in whole ms", "enligence/realtime_avatar", json.dumps(azure("offset", "viseme", MS, whole=True)), SEEN,
         remark=READ_IN_MS),
    Case("azure, offset and id", "Azure-Samples: avatars of pages", json.dumps(azure("offset", "id", MS)), SHIFTED,
         remark=READ_IN_MS),
    Case("azure, time and viseme", "the same", json.dumps(azure("time", "visemeId", MS, whole=True)), SEEN,
         remark=READ_IN_MS),
    Case("azure in seconds", "programs that divide by 10,000,000", json.dumps([{"time": at, "viseme": number}
         for at, number in VISEMES]), SEEN, remark=READ_IN_S),
    Case("azure, unit in the key", "programs that name it", json.dumps(azure("offset_ms", "viseme_id", MS, whole=True)),
         SEEN),
    Case("azure, audioOffsetMs", "the same", json.dumps(azure("audioOffsetMs", "visemeId", MS, whole=True)), SEEN),
    Case("azure, declared", "the same", json.dumps(azure("audio_offset", "viseme_id", MS, whole=True)), SEEN,
         options={"columns": "unit=ms"}),
    Case("azure, nested", "the same", json.dumps({"audio": "x.mp3", "visemes": azure("offset", "id", MS, whole=True)}),
         SEEN, remark=READ_IN_MS),
    Case("azure as a table", "the same", json.dumps(azure("offset", "id", MS, whole=True)), SEEN,
         options={"columns": "start=offset,label=id,unit=ms", "alphabet": "azure-visemes"}),
    Case("numbers without an alphabet", "the same", json.dumps([{"start": 0.0, "end": 0.1, "viseme": 12}]),
         "got numbers such as '12'.*alphabet=azure-visemes"),
    Case("rhubarb json", "DanielSWolf/rhubarb-lip-sync: README", json.dumps({"metadata": {}, "mouthCues": [
        {"start": 0.0, "end": 0.2, "value": "A"}, {"start": 0.2, "end": 0.4, "value": "D"}]}),
         [("p", 0, 0.2), ("ɑ", 0.2, 0.4)]),
    Case("rhubarb tsv", "the same", "0.00\tA\n0.20\tD\n0.40\tX\n", [("p", 0, 0.2), ("ɑ", 0.2, 0.4)], ".tsv"),
    Case("papagayo", "morevnaproject-org/papagayo-ng", text("lipsync version 1", "a.wav", 24, 24, 1, "\tanna",
         "\tboat", 1, "\t\tboat", "\t\t1", "\t\t12", 1, "\t\t\tboat 1 12 3", "\t\t\t\t1 MBP", "\t\t\t\t4 O",
         "\t\t\t\t9 etc"), [("m", 0, 0.125), ("o", 0.125, 8 / 24), ("t", 8 / 24, 1)], ".pgo"),
    Case("polly", "Amazon Polly developer guide: speech marks", text(*(json.dumps(
        {"time": at, "type": "viseme", "value": value}) for at, value in ((0, "p"), (100, "o"), (250, "sil")))),
         [("p", 0, 0.1), ("o", 0.1, 0.25)]),
    Case("phone list", "cmusphinx wrappers", json.dumps({"phones": timed(ARPA, "phone")}), IPA),
    Case("phone list, start_ms", "lists of web players", json.dumps({"phonemes": timed(ARPA, "phoneme", "start_ms",
         "end_ms", MS)}), IPA),
    Case("phone list of 10 ms each", "Muhammad-Bilal01/Rive-animation: shape of its list", json.dumps({"phonemes": [
        {"phoneme": "MAE"[n % 3].replace("A", "AA").replace("E", "EH"), "start": n / 100, "end": (n + 1) / 100}
        for n in range(6)]}), [("mɑɛ"[n % 3], n / 100, (n + 1) / 100) for n in range(6)],
         remark="the median of 6 phones is 10 ms"),
    Case("phone list in ms, read as s", "the same", json.dumps({"phones": [
        {"phone": "MS"[n % 2], "start": 50.0 * n, "end": 50.0 * n + 50} for n in range(6)]}),
         [("ms"[n % 2], 50.0 * n, 50.0 * n + 50) for n in range(6)], remark="columns='unit=ms' would make it 50 ms"),
)  # fmt: skip
CSV = text("start,end,phone", *(f"{a},{b},{label}" for label, a, b in IPA))
LISTS = (
    Case("csv", "R, pandas", CSV, IPA, ".csv"),
    Case("csv with comments", "the same", "# made by hand\n" + CSV, IPA, ".csv"),
    Case("csv with rows that are empty", "spreadsheets", CSV.replace("\n", "\n,,\n", 2), IPA, ".csv"),
    Case("csv with quotes and blanks", "the same", text('"start", "end", "phone"', *(
        f'"{a}", "{b}", "{label}"' for label, a, b in IPA)), IPA, ".csv"),
    Case("csv with semicolons and commas", "spreadsheets, in a locale that writes so",
         CSV.replace(",", ";").replace(".", ","), IPA, ".csv"),
    Case("tsv", "the same", CSV.replace(",", "\t"), IPA, ".tsv"),
    Case("blanks and a header", "R: write.table", CSV.replace(",", "  "), IPA, ".txt"),
    Case("csv without the last end", "lists of onsets", CSV.rsplit("0.31,0.42,s", 1)[0] + "0.31,,s\n",
         [*IPA[:3], ("s", 0.31, 0.41)], ".csv"),
    Case("csv with a column of no name", "spreadsheets", CSV.replace("start,end", "start,"),
         [*IPA[:3], ("s", 0.31, 0.41)], ".csv"),
    Case("csv of onsets", "lists of onsets", text("time,phoneme", *(f"{a},{label}" for label, a, _ in IPA)),
         [*IPA[:3], ("s", 0.31, 0.41)], ".csv"),
    Case("csv, onset and offset", "corpora", CSV.replace("start,end", "onset,offset"), IPA, ".csv"),
    Case("csv, offset and duration", "corpora", text("offset,duration,phone", *(f"{a},{b - a:.2f},{label}"
         for label, a, b in IPA)), IPA, ".csv"),
    Case("csv in ms", "the same", text("start_ms,end_ms,phone", *(f"{a * MS:.0f},{b * MS:.0f},{label}"
         for label, a, b in IPA)), IPA, ".csv"),
    Case("csv, ms and s", "the same", text("start_ms,duration_s,phone", *(f"{a * MS:.0f},{b - a:.2f},{label}"
         for label, a, b in IPA)), IPA, ".csv"),
    Case("csv in whole numbers", "the same", "start,end,phone\n0,80,b\n80,240,t\n", UNIT, ".csv"),
    Case("csv, declared", "the same", "von,bis,laut\n0,80,b\n80,240,oʊ\n", IPA[:2], ".csv",
         {"columns": "start=von,end=bis,label=laut,unit=ms"}),
    Case("csv, declared onsets", "the same", "von,laut\n0,b\n80,oʊ\n", [IPA[0], ("oʊ", 0.08, 0.18)], ".csv",
         {"columns": "start=von,label=laut,unit=ms"}),
    Case("csv, a column that is not there", "the same", CSV, "columns: got end=bis, but the file has", ".csv",
         {"columns": "end=bis"}),
    Case("csv, overlapping", "the same", "start,end,phone\n0.0,0.4,b\n0.2,0.5,t\n", "starts at 0.2 s, expected 0.4 s",
         ".csv"),
    Case("csv, unsorted", "the same", "start,end,phone\n0.5,0.6,b\n0.1,0.2,t\n", "starts at 0.1 s, expected 0.6 s",
         ".csv"),
    Case("csv of rows without length", "the same", "start,end,phone\n0.1,0.1,b\n0.2,0.2,t\n",
         "got 2 labels without length", ".csv"),
    Case("csv of phrases", "the same", "start,end,text\n0.0,1.0,paper boats\n1.0,2.0,float home\n", PHRASE, ".csv"),
    Case("json list", "lists of web players", json.dumps(timed(IPA, "phoneme")), IPA),
    Case("json list in camel case", "the same", json.dumps(timed(IPA, "phoneme", "startTime", "endTime")), IPA),
    Case("json list, startMs", "the same", json.dumps(timed(IPA, "phoneme", "startMs", "endMs", MS)), IPA),
    Case("json list, nested", "the same", json.dumps({"result": {"id": 5, "timings": timed(IPA, "phoneme")}}), IPA),
    Case("json lines", "the same", text(*map(json.dumps, timed(IPA, "phoneme"))), IPA),
    Case("json list of visemes", "lists of web players", json.dumps([
        {"time": 0.1, "viseme": "PP"}, {"time": 0.2, "viseme": "aa"}, {"time": 0.5, "viseme": "sil"}]),
         [("p", 0.1, 0.2), ("ɑ", 0.2, 0.5)]),
    Case("json list of visemes of Ready Player Me", "lists of web players: names of Ready Player Me", json.dumps({"cues": [
        {"start": 0.0, "end": 0.2, "viseme": "viseme_PP"}, {"start": 0.2, "end": 0.4, "viseme": "viseme_aa"}]}),
         [("p", 0, 0.2), ("ɑ", 0.2, 0.4)]),
    Case("csv of mouth shapes", "animators' lists", "start,end,mouth\n0.0,0.2,A\n0.2,0.4,D\n0.4,0.5,X\n", [
        ("p", 0, 0.2), ("ɑ", 0.2, 0.4)], ".csv"),
    Case("csv of visemes that no set has", "the same", "start,end,viseme\n0.0,0.2,M\n0.2,0.4,AA\n", [
        ("m", 0, 0.2), ("ɑ", 0.2, 0.4)], ".csv"),
    Case("json list of words", "the same", json.dumps({"lang": "fr", "items": timed(FR, "word")}), FR, language="fr"),
)  # fmt: skip


def _variants(case: Case) -> list[Case]:
    assert isinstance(case.data, str)
    return [
        replace(case, name=f"{case.name}, byte-order mark", data=case.data.encode("utf-8-sig")),
        replace(case, name=f"{case.name}, CRLF", data=case.data.replace("\n", "\r\n").encode()),
        replace(case, name=f"{case.name}, UTF-16", data=case.data.encode("utf-16")),
    ]


CORPUS = (*RECOGNIZERS, *ELAN, *SUBTITLES, *LABELS, *TOOLS, *LISTS)
VARIANTS = tuple(
    variant for case in CORPUS
    if case.name in {"whisper", "vtt of youtube", "srt", "audacity phones", "htk", "textgrid", "azure in ms", "csv"}
    for variant in _variants(case)
)  # fmt: skip
