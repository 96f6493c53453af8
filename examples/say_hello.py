"""Say a sentence from Python: the FAPs as a file, and a picture of the middle of the first vowel."""

import fapengine

hello = fapengine.speak("Hello there.", expressions={"joy": 0.4})
hello.save("out/hello.fap")
vowel = next(phone for phone in hello.phones.phones if phone.label == "ə")
hello.save("out/hello.png", at_s=(vowel.start_s + vowel.end_s) / 2)
print(f"{len(hello.track)} frames; see out/hello.fap and out/hello.png")
