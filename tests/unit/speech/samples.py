# ruff: noqa: E501
"""One small file of every format, spelled out after what the tools write or document."""

import json


def lines(*values: object) -> str:
    return "\n".join(json.dumps(value) for value in values)


SHORT_TEXTGRID = (
    '"ooTextFile"\n"TextGrid"\n0\n1\n<exists>\n1\n"IntervalTier"\n"phones"\n0\n1\n2\n0\n0.4\n"m"\n0.4\n1\n"ˈaɪ"\n'
)
CHRONOLOGICAL = """"Praat chronological TextGrid text file"
0 1 ! Time domain.
3 ! Number of tiers.
"IntervalTier" "words" 0 1
"IntervalTier" "phones" 0 1
"TextTier" "marks" 0 1
1 0 1
"my"
2 0 0.4
"M"
3 0.2
"here"
2 0.4 1
"AY1"
! the end
"""
# fmt: off
SAMPLES: dict[str, str] = {
    "textgrid": SHORT_TEXTGRID,
    "textgrid chronological": CHRONOLOGICAL,
    "mfa-json": json.dumps({"start": 0, "end": 1, "tiers": {
        "words": {"type": "interval", "entries": [[0, 1, "my"]]},
        "phones": {"type": "interval", "entries": [[0, 0.4, "M"], [0.4, 1, "AY1"]]}}}),
    "mfa-csv": "Begin,End,Label,Type,Speaker\n0,1,my,words,A\n0,0.4,M,phones,A\n0.4,1,AY1,phones,A\n",
    "espeak-json": json.dumps({"samplerate": 1000, "text": "my", "samples": 1000, "events": [
        {"type": "WORD", "sample": 0, "text_position": 1, "length": 2}, {"type": "PHONEME", "sample": 0, "phoneme": "m"},
        {"type": "PHONEME", "sample": 400, "phoneme": "aI"}, {"type": "PHONEME", "sample": 900, "phoneme": "_:"}]}),
    "espeak-json numbers": json.dumps([
        {"type": 7, "audio_position": 0, "phoneme": "m"}, {"type": 7, "audio_position": 400, "phoneme": "aɪ"},
        {"type": 7, "audio_position": 500, "phoneme": "ʲ"}, {"type": 5, "audio_position": 1000}]),
    "polly": lines(
        {"time": 0, "type": "sentence", "start": 0, "end": 2, "value": "my"},
        {"time": 0, "type": "word", "start": 0, "end": 2, "value": "my"}, {"time": 0, "type": "viseme", "value": "p"},
        {"time": 400, "type": "viseme", "value": "a"}, {"time": 1000, "type": "viseme", "value": "sil"}),
    "polly words": lines({"time": 0, "type": "word", "value": "my"}, {"time": 900, "type": "word", "value": "oh"}),
    "azure": json.dumps([{"audio_offset": 0, "viseme_id": 21}, {"audio_offset": 4_000_000, "viseme_id": 11},
                         {"audio_offset": 10_000_000, "viseme_id": 0}]),
    "azure lines": lines({"AudioOffset": 0, "VisemeId": 21}, {"AudioOffset": 4_000_000, "VisemeId": 11},
                         {"AudioOffset": 10_000_000, "VisemeId": 0}),
    "elevenlabs": json.dumps({"audio_base64": "", "alignment": None, "normalized_alignment": {
        "characters": list("my oh"), "character_start_times_seconds": [0.0, 0.2, 0.4, 0.5, 0.7],
        "character_end_times_seconds": [0.2, 0.4, 0.5, 0.7, 1.0]}}),
    "elevenlabs stream": lines(
        {"audio": "", "alignment": {"chars": list("my"), "charStartTimesMs": [0, 200], "charDurationsMs": [200, 200]}},
        {"audio": "", "alignment": {"chars": list(" oh"), "charStartTimesMs": [0, 100, 300],
                                    "charDurationsMs": [100, 200, 300]}},
        {"audio": None, "isFinal": True}),
    "elevenlabs aligned": json.dumps({"words": [{"text": "my", "start": 0, "end": 0.4, "loss": 0.1},
                                                {"text": " ", "start": 0.4, "end": 0.5},
                                                {"text": "oh", "start": 0.5, "end": 1}]}),
    "cartesia": lines(
        {"type": "timestamps", "word_timestamps": {"words": ["my"], "start": [0], "end": [1]}},
        {"type": "phoneme_timestamps",
         "phoneme_timestamps": {"phonemes": ["m", "aɪ"], "start": [0, 0.4], "end": [0.4, 1]}}),
    "cartesia words": json.dumps({"word_timestamps": {"words": ["my", "oh"], "start": [0, 0.5], "end": [0.4, 1]}}),
    "voicevox": json.dumps({"speedScale": 2, "prePhonemeLength": 0.2, "postPhonemeLength": 0.2, "accent_phrases": [
        {"moras": [{"text": "マ", "consonant": "m", "consonant_length": 0.2, "vowel": "a", "vowel_length": 0.6},
                   {"text": "ン", "consonant": None, "consonant_length": None, "vowel": "N", "vowel_length": 0.4}],
         "pause_mora": {"text": "、", "vowel": "pau", "vowel_length": 0.4}}]}),
    "kokoro": json.dumps({"tokens": [{"text": "my", "phonemes": "mˌI", "start_ts": 0, "end_ts": 1},
                                     {"text": ".", "phonemes": ".", "start_ts": None, "end_ts": None}]}),
    "kokoro durations": json.dumps({"phonemes": "mˈI .", "pred_dur": [4, 12, 2, 10, 2, 6, 4]}),
    "headtts": json.dumps({"type": "audio", "ref": 1, "data": {
        "visemes": ["PP", "aa", "I"], "vtimes": [-10, 390, 690], "vdurations": [420, 320, 310], "words": ["my"]}}),
    "piper": json.dumps({"last": {"alignments": [
        {"phoneme": "^", "seconds": 0.1}, {"phoneme": "m", "seconds": 0.2}, {"phoneme": "ˈ", "seconds": 0.1},
        {"phoneme": "a", "seconds": 0.2}, {"phoneme": "ɪ", "seconds": 0.1}, {"phoneme": "ː", "seconds": 0.1},
        {"phoneme": " ", "seconds": 0.1}, {"phoneme": "$", "seconds": 0.1}]}}),
    "piper samples": json.dumps([
        {"sample_rate": 1000, "phoneme_alignments": [{"phoneme": "ˈ", "phoneme_ids": [120], "num_samples": 100},
                                                     {"phoneme": "m", "phoneme_ids": [25], "num_samples": 300}]},
        {"sample_rate": 1000, "phoneme_alignments": [{"phoneme": "a", "num_samples": 600}]}]),
    "rhubarb-json": json.dumps({"metadata": {"duration": 1}, "mouthCues": [
        {"start": 0, "end": 0.45, "value": "A"}, {"start": 0.4, "end": 0.9, "value": "D"},
        {"start": 0.9, "end": 1, "value": "X"}]}),
    "rhubarb-xml": '<?xml version="1.0" encoding="utf-8"?>\n<rhubarbResult><mouthCues><mouthCue start="0.00" end="0.40">A'
                   '</mouthCue><mouthCue start="0.40" end="1.00">D</mouthCue></mouthCues></rhubarbResult>',
    "rhubarb-tsv": "0.00\tA\n0.40\tD\n0.90\tX\n1.00\tX\n",
    "phone-list": json.dumps({"phones": [{"start": 0, "end": 0.4, "phone": "M", "word": "my"},
                                         {"start": 0.4, "end": 1, "phone": "AY", "word": "my"}]}),
    "phone-list lengths": json.dumps({"phonemes": [
        {"phoneme": "<sos/eos>", "offset": 0, "duration": 100}, {"phoneme": "M", "offset": 100, "duration": 300},
        {"phoneme": "AY1", "offset": 400, "duration": 600}, {"phoneme": ".", "offset": 1000, "duration": 10}]}),
    "align": "0 10000 sil\n10000 20000 my\n20000 25000 oh\n",
    "xlabel": "signal x\nnfields 1\n#\n0.1 100 pau\n0.4 100 m\n1.0 100 ay\n",
    "xlabel words": "#\n0.4 100 The\n1.0 100 birch\n",
    "htk": "0 4000000 m\n4000000 10000000 ay\n",
    "htk context": "0 4000000 x^sil-m+ay=sil@1\n4000000 10000000 sil^m-ay+sil=x@1\n",
    "htk seconds": "0.0\t0.4\tm\n0.4\t1.0\tay\n",
    "flite": "pau:0.1 m:0.4 ay:1.0 \n",
    "pho": "; my\n_ 100\nm 300\naI 600 0 120\n",
}
# fmt: on
