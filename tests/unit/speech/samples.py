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
    "align": "0 10000 sil\n10000 20000 bin\n20000 25000 blue\n",
    "xlabel": "signal x\nnfields 1\n#\n0.1 100 pau\n0.4 100 m\n1.0 100 ay\n",
    "xlabel words": "#\n0.4 100 The\n1.0 100 birch\n",
    "htk": "0 4000000 m\n4000000 10000000 ay\n",
    "mlf": '#!MLF!#\n"./plp/talk.rec"\n0 0 sp -0.1 sp\n0 4000000 M -52.3 my\n4000000 10000000 AY1 93.0\n.\n',
    "allosaurus": "0.000 0.045 m\n0.400 0.045 aɪ\n",
    "htk context": "0 4000000 x^sil-m+ay=sil@1\n4000000 10000000 sil^m-ay+sil=x@1\n",
    "htk seconds": "0.0\t0.4\tm\n0.4\t1.0\tay\n",
    "flite": "pau:0.1 m:0.4 ay:1.0 \n",
    "pho": "; my\n_ 100\nm 300\naI 600 0 120\n",
    "textgrid collection": 'File type = "ooTextFile"\nObject class = "Collection"\n\nsize = 1\nitem []:\n    item [1]:\n'
                           '        class = "TextGrid"\n        name = "one"\n' + SHORT_TEXTGRID.split('"TextGrid"\n')[1],
    "textgrid old": 'File type = "ooTextFile short"\n' + SHORT_TEXTGRID.split("\n", 1)[1],
    "whisper": json.dumps({"segments": [{"start": 0, "end": 1, "text": " my oh", "words": [
        {"word": " my", "start": 0.0, "end": 0.4, "score": 0.9}, {"word": " oh.", "start": 0.5, "end": 1.0}]}],
        "word_segments": [{"word": "my", "start": 0.0, "end": 0.4}]}),
    "whisper timestamped": json.dumps({"text": "my oh", "segments": [{"id": 0, "start": 0, "end": 1, "words": [
        {"text": "my", "start": 0.0, "end": 0.4, "confidence": 0.9},
        {"text": "oh", "start": 0.5, "end": 1.0, "confidence": 0.9}]}]}),
    "openai-words": json.dumps({"task": "transcribe", "duration": 1.0, "text": "My. Oh.", "words": [
        {"word": "My", "start": 0.0, "end": 0.4}, {"word": "Oh", "start": 0.5, "end": 1.0}]}),
    "whisper-cpp": json.dumps({"result": {"language": "en"}, "transcription": [{
        "offsets": {"from": 0, "to": 1000}, "text": " my oh.", "tokens": [
            {"text": "[_BEG_]", "offsets": {"from": 0, "to": 0}, "id": 50363},
            {"text": " m", "offsets": {"from": 0, "to": 100}}, {"text": "y", "offsets": {"from": 100, "to": 400}},
            {"text": " oh", "offsets": {"from": 500, "to": 1000}}, {"text": ".", "offsets": {"from": 1000, "to": 1000}},
            {"text": "[_TT_50]", "offsets": {"from": 1000, "to": 1000}}]}]}),
    "whisper-cpp words": json.dumps({"transcription": [
        {"timestamps": {"from": "00:00:00,000", "to": "00:00:00,400"}, "offsets": {"from": 0, "to": 400}, "text": " my"},
        {"timestamps": {"from": "00:00:00,500", "to": "00:00:01,000"}, "offsets": {"from": 500, "to": 1000}, "text": " oh"}]}),
    "transformers": json.dumps({"text": " my oh", "chunks": [
        {"text": " my", "timestamp": [0.0, 0.4]}, {"text": " oh", "timestamp": [0.5, 1.0]}]}),
    "vosk": json.dumps({"result": [{"conf": 1.0, "end": 0.4, "start": 0.0, "word": "my"},
                                   {"conf": 1.0, "end": 1.0, "start": 0.5, "word": "oh"}], "text": "my oh"}),
    "vosk stream": lines({"partial": "my"}, {"result": [{"conf": 1, "end": 0.4, "start": 0.0, "word": "my"}], "text": "my"},
                         {"result": [{"conf": 1, "end": 1.0, "start": 0.5, "word": "oh"}], "text": "oh"}),
    "deepgram": json.dumps({"metadata": {"channels": 1}, "results": {"channels": [{"alternatives": [{
        "transcript": "my oh", "words": [
            {"word": "my", "start": 0.0, "end": 0.4, "confidence": 0.9, "punctuated_word": "my"},
            {"word": "oh", "start": 0.5, "end": 1.0, "confidence": 0.9, "punctuated_word": "oh."}]}]}]}}),
    "assemblyai": json.dumps({"id": "x", "status": "completed", "words": [
        {"text": "my", "start": 0, "end": 400, "confidence": 0.9, "speaker": None},
        {"text": "oh.", "start": 500, "end": 1000, "confidence": 0.9, "speaker": None}]}),
    "aws-transcribe": json.dumps({"jobName": "x", "results": {"transcripts": [{"transcript": "my oh."}], "items": [
        {"type": "pronunciation", "start_time": "0.0", "end_time": "0.4", "alternatives": [{"content": "my"}]},
        {"type": "pronunciation", "start_time": "0.5", "end_time": "1.0", "alternatives": [{"content": "oh"}]},
        {"type": "punctuation", "alternatives": [{"content": "."}]}]}}),
    "google-speech": json.dumps({"results": [{"alternatives": [{"transcript": "my oh", "words": [
        {"startTime": "0s", "endTime": "0.400s", "word": "my"},
        {"startTime": "0.500s", "endTime": "1s", "word": "oh"}]}]}]}),
    "google-speech v2": json.dumps({"results": [{"alternatives": [{"words": [
        {"endOffset": "0.400s", "word": "my"}, {"startOffset": "0.500s", "endOffset": "1s", "word": "oh"}]}]}]}),
    "soniox": json.dumps({"tokens": [
        {"text": "m", "start_ms": 0, "end_ms": 100, "is_final": True}, {"text": "y", "start_ms": 100, "end_ms": 400},
        {"text": " ", "start_ms": 400, "end_ms": 500}, {"text": "oh", "start_ms": 500, "end_ms": 1000},
        {"text": "<end>", "start_ms": 1000, "end_ms": 1000}]}),
    "kokoro-fastapi": json.dumps({"audio": "", "audio_format": "mp3", "timestamps": [
        {"word": "my", "start_time": 0.0, "end_time": 0.4}, {"word": "oh", "start_time": 0.5, "end_time": 1.0},
        {"word": ".", "start_time": 1.0, "end_time": 1.1}]}),
    "edge-tts": lines({"type": "WordBoundary", "offset": 0, "duration": 4_000_000, "text": "my"},
                      {"type": "SentenceBoundary", "offset": 0, "duration": 10_000_000, "text": "my oh"},
                      {"type": "WordBoundary", "offset": 5_000_000, "duration": 5_000_000, "text": "oh"}),
    "edge-tts metadata": json.dumps({"Metadata": [
        {"Type": "WordBoundary", "Data": {"Offset": 0, "Duration": 4_000_000, "text": {"Text": "my", "Length": 2}}},
        {"Type": "WordBoundary", "Data": {"Offset": 5_000_000, "Duration": 5_000_000, "text": {"Text": "oh"}}}]}),
    "azure-batch": json.dumps([{"Text": "my", "AudioOffset": 0, "Duration": 400},
                               {"Text": "oh", "AudioOffset": 500, "Duration": 500}]),
    "gentle": json.dumps({"transcript": "my", "words": [
        {"alignedWord": "my", "case": "success", "start": 0.0, "end": 1.0, "startOffset": 0, "endOffset": 2, "word": "my",
         "phones": [{"duration": 0.4, "phone": "m_B"}, {"duration": 0.6, "phone": "ay_E"}]},
        {"case": "not-found-in-audio", "startOffset": 3, "endOffset": 5, "word": "oh"}]}),
    "gentle words": json.dumps({"transcript": "my oh", "words": [
        {"alignedWord": "my", "case": "success", "start": 0.0, "end": 0.4, "word": "my", "phones": []},
        {"alignedWord": "oh", "case": "success", "start": 0.5, "end": 1.0, "word": "oh", "phones": []}]}),
    "pocketsphinx": lines({"b": 0, "d": 1.0, "p": 1.0, "t": "my", "w": [
        {"b": 0.0, "d": 1.0, "p": 1.0, "t": "my(2)", "w": [
            {"b": 0.0, "d": 0.4, "p": 1.0, "t": "M"}, {"b": 0.4, "d": 0.6, "p": 1.0, "t": "AY"}]}]}),
    "pocketsphinx words": lines({"b": 0, "d": 1.0, "p": 1.0, "t": "my oh", "w": [
        {"b": 0.0, "d": 0.4, "p": 1.0, "t": "my"}, {"b": 0.4, "d": 0.1, "p": 1.0, "t": "<sil>"},
        {"b": 0.5, "d": 0.5, "p": 1.0, "t": "oh"}]}),
    "cartesia stream": lines(
        {"type": "chunk", "data": ""}, {"type": "chunk", "data": ""},
        {"type": "timestamps", "word_timestamps": {"words": ["my", "oh"], "start": [0, 0.5], "end": [0.4, 1]}}),
    "aeneas": json.dumps({"fragments": [
        {"begin": "0.000", "children": [], "end": "0.400", "id": "f000001", "language": "eng", "lines": ["my"]},
        {"begin": "0.500", "children": [], "end": "1.000", "id": "f000002", "language": "eng", "lines": ["oh"]}]}),
    "inworld": json.dumps({"timestampInfo": {"wordAlignment": {
        "words": ["my"], "wordStartTimeSeconds": [0], "wordEndTimeSeconds": [1], "phoneticDetails": [
            {"wordIndex": 0, "isPartial": False, "phones": [
                {"phoneSymbol": "m", "startTimeSeconds": 0, "durationSeconds": 0.4, "visemeSymbol": "bmp"},
                {"phoneSymbol": "aɪ", "startTimeSeconds": 0.4, "durationSeconds": 0.6, "visemeSymbol": "aei"}]}]}}}),
    "inworld visemes": lines({"result": {"timestampInfo": {"wordAlignment": {
        "words": ["my"], "wordStartTimeSeconds": [0], "wordEndTimeSeconds": [1], "phoneticDetails": [
            {"wordIndex": 0, "phones": [
                {"startTimeSeconds": 0, "durationSeconds": 0.4, "visemeSymbol": "bmp"},
                {"startTimeSeconds": 0.4, "durationSeconds": 0.6, "visemeSymbol": "aei"}]}]}}}}, {"result": {}}),
    "inworld words": json.dumps({"timestampInfo": {"wordAlignment": {
        "words": ["my", " ", "oh", "."], "wordStartTimeSeconds": [0, 0.4, 0.5, 1.0],
        "wordEndTimeSeconds": [0.4, 0.5, 1.0, 1.0]}}}),
    "hume": lines(*(
        {"type": "timestamp", "request_id": "r", "generation_id": "g", "snippet_id": "s",
         "timestamp": {"type": kind, "text": said, "time": {"begin": begin, "end": end}}}
        for kind, said, begin, end in (("word", "my", 0, 1000), ("phoneme", "m", 0, 400), ("phoneme", "aɪ", 400, 1000)))),
    "hume words": json.dumps({"generations": [{"generation_id": "g", "audio": "", "snippets": [[
        {"id": "s", "timestamps": [{"text": "my", "time": {"begin": 0, "end": 400}, "type": "word"},
                                   {"text": "oh", "time": {"begin": 500, "end": 1000}, "type": "word"}]}]]}]}),
    "resemble": json.dumps({"success": True, "audio_content": "", "audio_timestamps": {
        "graph_chars": list("my."), "graph_times": [[0, 0.45], [0.4, 0.9], [0.8, 1.0]],
        "phon_chars": ["m", "aɪ", "ː", "."], "phon_times": [[0, 0.45], [0.4, 0.8], [0.7, 0.9], [0.9, 1.0]]}}),
    "resemble words": json.dumps({"item": {"timestamps": {
        "graph_chars": list("my oh"), "graph_times": [[0, 0.2], [0.2, 0.4], [0.4, 0.5], [0.5, 0.7], [0.65, 1.0]],
        "phon_chars": [], "phon_times": []}}}),
    "fish": "\n\n".join("data: " + line for line in lines(
        {"audio_base64": "", "content": "my", "alignment": None, "chunk_seq": 0, "chunk_audio_offset_sec": 0},
        {"audio_base64": "", "alignment": {"segments": [{"text": "m", "start": 0, "end": 0.2}], "audio_duration": 0.2},
         "chunk_seq": 0, "chunk_audio_offset_sec": 0},
        {"audio_base64": "", "alignment": {"segments": [{"text": "my", "start": 0, "end": 0.4}], "audio_duration": 0.5},
         "chunk_seq": 0, "chunk_audio_offset_sec": 0},
        {"audio_base64": "", "alignment": {"segments": [{"text": "oh.", "start": 0, "end": 0.5}], "audio_duration": 0.5},
         "chunk_seq": 1, "chunk_audio_offset_sec": 0.5}).split("\n")),
    "diffsinger": json.dumps([{"offset": 0.0, "text": "SP 妈 SP", "ph_seq": "SP zh/m zh/a SP", "ph_dur": "0.1 0.3 0.5 0.1",
                               "note_seq": "rest C4 rest"}]),
    "subtitles": "1\n00:00:00,000 --> 00:00:00,400\nmy\n\n2\n00:00:00,500 --> 00:00:01,000\noh.\n",
    "subtitles inside": "WEBVTT\nKind: captions\n\n00:00.000 --> 00:01.000 align:start position:0%\n"
                        "my<00:00:00.400><c> </c><00:00:00.500><c> oh</c>\n\n00:01.000 --> 00:01.010\nmy oh\n",
    "subtitles underlined": "1\n00:00:00,000 --> 00:00:00,400\n<u>my</u> oh\n\n2\n00:00:00,400 --> 00:00:00,500\nmy oh\n\n"
                            "3\n00:00:00,500 --> 00:00:01,000\nmy <u>oh</u>\n",
    "papagayo": "lipsync version 1\nmy.wav\n10\n10\n1\n\tVoice 1\n\tmy\n\t1\n\t\tmy\n\t\t1\n\t\t10\n\t\t1\n"
                "\t\t\tmy 1 10 2\n\t\t\t\t1 MBP\n\t\t\t\t5 AI\n",
    "moho": "MohoSwitch1\n1 MBP\n5 AI\n11 rest\n",
    "utau": "[#VERSION]\nUST Version1.2\n[#SETTING]\nTempo=120.00\nTracks=1\n[#0000]\nLength=96\nLyric=R\nNoteNum=60\n"
            "[#0001]\nLength=288\nLyric=- ま\nNoteNum=60\n[#0002]\nLength=576\nLyric=a い\nNoteNum=62\n[#TRACKEND]\n",
    "timit": "0 1600 h#\n1600 4000 bcl\n4000 6400 b\n6400 16000 ay\n",
    "ctm": "talk 1 0.00 0.40 m_B 0.99\ntalk 1 0.40 0.60 ay_E 1.00\n",
    "ctm words": ";; a comment\ntalk A 0.00 0.40 montreal\ntalk A 0.50 0.50 aligner 0.9 lex\n",
    "papagayo json": json.dumps({"fps": 10, "sound_duration": 10, "voices": [{"name": "anna", "phrases": [{"words": [
        {"text": "my", "phonemes": [{"text": "MBP", "frame": 1}, {"text": "AI", "frame": 5}]}]}]}]}),
    "elan": '<?xml version="1.0"?><ANNOTATION_DOCUMENT FORMAT="3.0"><TIME_ORDER><TIME_SLOT TIME_SLOT_ID="a" TIME_VALUE="0"/>'
            '<TIME_SLOT TIME_SLOT_ID="b" TIME_VALUE="400"/><TIME_SLOT TIME_SLOT_ID="c" TIME_VALUE="1000"/></TIME_ORDER>'
            '<TIER TIER_ID="phones"><ANNOTATION><ALIGNABLE_ANNOTATION TIME_SLOT_REF1="a" TIME_SLOT_REF2="b">'
            '<ANNOTATION_VALUE>M</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION><ANNOTATION><ALIGNABLE_ANNOTATION'
            ' TIME_SLOT_REF1="b" TIME_SLOT_REF2="c"><ANNOTATION_VALUE>AY1</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION>'
            '</ANNOTATION></TIER></ANNOTATION_DOCUMENT>',
    "azure-speech": json.dumps({"combinedPhrases": [], "phrases": [{"text": "My, oh.", "locale": "en-US", "words": [
        {"text": "my", "offsetMilliseconds": 0, "durationMilliseconds": 400},
        {"text": "oh", "offsetMilliseconds": 500, "durationMilliseconds": 500}]}]}),
    "azure-speech-ticks": json.dumps({"Id": "1", "DisplayText": "My, oh.", "Offset": 0, "Duration": 10000000, "NBest": [
        {"Words": [{"Word": "my", "Offset": 0, "Duration": 4000000},
                   {"Word": "oh", "Offset": 5000000, "Duration": 5000000}]}]}),
    "rev": json.dumps({"monologues": [{"speaker": 0, "elements": [
        {"type": "text", "value": "my", "ts": 0.0, "end_ts": 0.4}, {"type": "punct", "value": ", "},
        {"type": "text", "value": "oh", "ts": 0.5, "end_ts": 1.0}, {"type": "punct", "value": "."}]}]}),
    "speechmatics": json.dumps({"metadata": {"transcription_config": {"language": "en"}}, "results": [
        {"type": "word", "start_time": 0.0, "end_time": 0.4, "alternatives": [{"content": "my"}]},
        {"type": "punctuation", "start_time": 0.4, "end_time": 0.4, "alternatives": [{"content": ","}]},
        {"type": "word", "start_time": 0.5, "end_time": 1.0, "alternatives": [{"content": "oh"}]}]}),
    "gladia": json.dumps({"result": {"transcription": {"languages": ["en"], "utterances": [
        {"text": "my oh", "start": 0.0, "end": 1.0, "words": [{"word": "my", "start": 0.0, "end": 0.4},
                                                              {"word": " oh", "start": 0.5, "end": 1.0}]}]}}}),
    "watson": json.dumps({"results": [{"final": True, "alternatives": [
        {"transcript": "my oh", "timestamps": [["my", 0.0, 0.4], ["oh", 0.5, 1.0]]}]}]}),
    "table": "start,end,phone\n0.0,0.4,m\n0.4,1.0,aɪ\n",
    "table words": "word\tbegin_ms\tduration_ms\nmy\t0\t400\noh\t500\t500\n",
    "table json": json.dumps([{"phone": "m", "start": 0.0, "end": 0.4}, {"phone": "aɪ", "start": 0.4, "end": 1.0}]),
}
# fmt: on
