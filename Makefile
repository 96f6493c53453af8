# make help lists the targets.
# Nothing is needed beforehand but python3 (3.11 or newer), git and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Half of pip's time compiles modules, one after the other: two at once take half of that. As with pip, those that do not
# compile on this Python are left.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile
COMPILE := $(BIN)/python -m compileall -q -j 2 $(VENV)/lib > /dev/null 2>&1 || true
# Hundreds of processes of tests would each compile all modules again.
unexport PYTHONDONTWRITEBYTECODE
# A run of fewer tests than this fails: raise it when tests are added.
TESTS_AT_LEAST := 10500
# Of make nightly.
NIGHTLY_AT_LEAST := 110
# Tests of conformance, which run in every clone.
CONFORMANCE_AT_LEAST := 300
# How long make fuzz searches: a third of it in the codec, a third in every reader, a sixth with mutated files, a sixth
# with random command lines. With INPUTS=n or COMMANDS=n those two end after that number instead.
SECONDS := 600
INPUTS :=
COMMANDS :=
# How long make soak uses a server, and then a face in a page.
MINUTES := 30
# Of make faults.
MOMENTS := 200
SEED := 1
CORE_TESTS := $(addprefix tests/unit/,capture codec engine geometry ground laboratory mesh models mpeg4 profiles retarget scoring speech \
    trajectory wire)
# Of make tests: --write-slow measures which tests are slow and which files are long.
OPTIONS :=
SENTENCE := Bright sunshine shimmers on the ocean.

.PHONY: native wheels nightly people faults oracles pyodide conformance detector help demo test tests check quick coverage matrix release-check licences bench soak fuzz fuzz-replay fresh-machine \
    clean docs env dev tools

help:
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-15s%s\n", $$1, $$2}' Makefile

demo: $(VENV)/.ready  ## say a sentence: out/demo.mp4, demo.fap, demo.wav, demo.png
	@[ -z "$$(command -v cc || command -v gcc || command -v clang)" ] || $(MAKE) --no-print-directory $(VENV)/.ready-native || \
	    echo "renderer in C absent: it does not build here, so OpenGL draws" >&2
	$(BIN)/fapengine say "$(SENTENCE)" --expression joy:0.4 -o out/demo.mp4
	@$(BIN)/fapengine doctor | grep renderer

# The others take one processor, one after the other, while the tests wait for clocks and sound cards.
test:  ## everything that CI runs
	@$(MAKE) --no-print-directory -j 2 $(VENV)/.ready-dev detector
	@$(MAKE) --no-print-directory -j 2 tests check conformance fuzz-replay

# Of four processes two take files that compute, the others files that wait, the long ones first: tests/queues.py.
# One thread each for linear algebra: three processes with two threads each on two cores wait for each other.
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 4 --dist loadfile -q
tests: $(VENV)/.read-tests detector
	$(PYTEST) $(OPTIONS) -m "not nightly" --at-least $(TESTS_AT_LEAST)

# What takes too long for every change; the hosted CI runs it every night.
nightly: $(VENV)/.read-tests detector  ## the tests that make test leaves out because they take long
	$(PYTEST) -m nightly --at-least $(NIGHTLY_AT_LEAST)
	@mkdir -p out/fuzz-replay/readers
	$(BIN)/python -m tests.fuzz.fuzz_readers out/fuzz-replay/readers -runs=0 > out/fuzz.log 2>&1 || { tail -n 40 out/fuzz.log; exit 1; }

# In a new clone pytest rewrites the assertions of every test and keeps them: once, or each of four processes does it.
$(VENV)/.read-tests: $(VENV)/.ready-dev
	$(BIN)/python -m pytest --collect-only -qq > /dev/null
	@touch $@

# As in a clone with nothing beside it: the measurement data are hidden. Only files that have such tests are read.
conformance: $(VENV)/.ready-dev  ## the tests of the standard's bytes and tables; they need nothing but a clone
	FAPENGINE_SHARED=/nonexistent $(BIN)/python -m pytest -q -m conformance --at-least $(CONFORMANCE_AT_LEAST) \
	    $$(grep -rl --include='test_*.py' 'mark\.conformance' tests)

check: $(VENV)/.ready-dev  ## format, lint, types and layers of the imports
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache > /dev/null || $(BIN)/lint-imports --no-cache

quick: $(VENV)/.ready-dev  ## the unit tests, without the slow ones
	$(BIN)/python -m pytest -n 2 --dist loadfile -q -m "not slow" tests/unit

# Not a part of make test, which it would make longer; the hosted CI runs it.
coverage: $(VENV)/.ready-dev  ## branch coverage of the core by its unit tests, against its limit
	$(BIN)/python -m pytest -n 2 --dist loadfile -q -m "not shared" \
	    --cov --cov-report=term:skip-covered $(CORE_TESTS)

matrix: $(VENV)/.ready-tools  ## the unit tests on every supported Python that is installed
	$(BIN)/nox --session tests

# Each file's licence is stated and its text is here; licences of the installed packages.
licences: $(VENV)/.ready-tools  ## check that every file states its licence, and list those of installed packages
	$(BIN)/reuse lint --quiet || $(BIN)/reuse lint
	$(BIN)/fapengine doctor --licences

release-check: licences  ## build what would be published, install it into a bare environment and use it
	.ci/release-check $(BIN)/python

bench: $(VENV)/.ready-dev  ## speed, as ratios against named references
	@failed=0; for name in say render codec models capture sessions osc live; do \
	    echo "== $$name"; $(BIN)/python -m bench.$$name || failed=1; done; exit $$failed

soak: $(VENV)/.ready-dev  ## use a live server and a face in Chromium for 30 minutes each (MINUTES=n): nothing may grow
	$(BIN)/python -m bench.live_soak --minutes $(MINUTES)
	$(BIN)/python -m tests.browser.live_memory --minutes $(MINUTES)

# The part of make fuzz that make test runs: the same inputs and commands every time, so that the gate judges the change
# and not the luck of a search.
fuzz-replay: $(VENV)/.ready-dev  ## the part of it that make test runs: the same inputs every time
	@mkdir -p out/fuzz-replay
	$(BIN)/python -m tests.fuzz.fuzz_decoder out/fuzz-replay tests/fuzz/corpus -runs=0 > out/fuzz.log 2>&1 || { tail -n 40 out/fuzz.log; exit 1; }
	$(BIN)/python -m tests.fuzz.command_lines --seconds inf --count 30
	$(BIN)/python -m tests.fuzz.mutated --seconds inf --each 40 > out/fuzz.log 2>&1 || { tail -n 60 out/fuzz.log; exit 1; }
	@tail -n 1 out/fuzz.log

fuzz: $(VENV)/.ready-dev  ## search for bytes and command lines that break something, for 10 minutes (SECONDS=n)
	@mkdir -p out/fuzz
	$(BIN)/python -m tests.fuzz.fuzz_decoder out/fuzz tests/fuzz/corpus -max_total_time=$$(($(SECONDS) / 3)) \
	    -artifact_prefix=out/fuzz/ -print_final_stats=1 > out/fuzz.log 2>&1 || { tail -n 40 out/fuzz.log; exit 1; }
	@grep 'stat::' out/fuzz.log
	$(BIN)/python -m tests.fuzz.fuzz_readers out/fuzz/readers -max_total_time=$$(($(SECONDS) / 3)) \
	    -artifact_prefix=out/fuzz/ -print_final_stats=1 > out/fuzz.log 2>&1 || { tail -n 40 out/fuzz.log; exit 1; }
	@grep 'stat::' out/fuzz.log
	$(BIN)/python -m tests.fuzz.command_lines $(if $(COMMANDS),--seconds inf --count $(COMMANDS),--seconds $$(($(SECONDS) / 6)))
	$(BIN)/python -m tests.fuzz.mutated $(if $(INPUTS),--seconds inf --inputs $(INPUTS),--seconds $$(($(SECONDS) / 6))) \
	    > out/fuzz.log 2>&1 || { tail -n 60 out/fuzz.log; exit 1; }
	@tail -n 1 out/fuzz.log

# Two hundred random people instead of the fifteen of make test: every promise of the face.
people: $(VENV)/.ready-dev  ## check 200 random people, where make test checks 15
	RANDOM_PEOPLE=200 $(BIN)/python -m pytest -n 2 -q tests/unit/mesh/test_people.py

faults: $(VENV)/.ready-dev  ## kill commands, servers and their parts at 200 random moments (MOMENTS=n)
	$(BIN)/python -m tests.faults --moments $(MOMENTS) --seed $(SEED)

# Links and cross references that lead nowhere are errors.
docs: $(VENV)/.ready-docs  ## the documentation as a site: out/site/index.html
	PYTHONPATH=. $(BIN)/mkdocs build --strict

# The npm package is built into projects by these.
BUNDLERS := vite@8.3.8 @vitejs/plugin-react@6.3.0 react@19.3.1 react-dom@19.3.1 @types/react@19.3.0 \
    @types/react-dom@19.3.0 vue@3.5.45 @vitejs/plugin-vue@6.0.11 vue-tsc@3.3.14 svelte@5.57.3 \
    @sveltejs/vite-plugin-svelte@7.3.1 svelte-check@4.7.8 @pipecat-ai/client-js@1.13.1 \
    @pipecat-ai/small-webrtc-transport@1.10.8

# Foreign programs that ours is compared with; they need Node and a network, and no test needs them. Avatars of others
# are tried too, as far as they lie in out/oracles/avatars; Blender (with python3-numpy), coturn, nginx, godot3, godot3-server and mono-mcs of Debian, where they are
# installed. axe-core, TypeScript and, where it is installed, Firefox judge the page and the npm package. Ten minutes.
oracles: $(VENV)/.ready-dev  ## compare with other programs: Blender, three.js, Firefox, Pipecat, NATS and more; needs Node
	.ci/system-packages $(PYTHON) oracles
	mkdir -p out/oracles
	npm install --prefix out/oracles --no-save --no-audit --no-fund rhubarb-lip-sync-wasm@0.1.8 @met4citizen/headaudio@0.1.0 \
	    gltf-validator@2.0.0-dev.3.10 three@0.187 @pixiv/three-vrm@3.5.5 @met4citizen/talkinghead@1.7.0 axe-core@4.10.3 typescript@5.9.3 $(PYODIDE) $(BUNDLERS)
	$(MAKE) --no-print-directory --keep-going $(ORACLES)

# Each can be made again alone, and the others go on where one fails.
ORACLES := oracles-programs oracles-pages oracles-bus oracles-agents oracles-voices
.PHONY: $(ORACLES)
oracles-programs:
	$(BIN)/python -m tests.oracles out/oracles
oracles-pages:
	$(BIN)/python -m tests.browser.oracles
oracles-bus:
	$(BIN)/python -m tests.oracles.bus
oracles-agents:
	$(PYTHON) -m venv out/oracles/frameworks
	out/oracles/frameworks/bin/python -m pip install --quiet --upgrade "pip>=25.1"
	out/oracles/frameworks/bin/python -m pip install --quiet --group frameworks --editable ".[voice,recognizer]"
	out/oracles/frameworks/bin/python -m pytest -q -s -p no:cacheprovider -c tests/frameworks/pytest.ini --rootdir=. \
	    tests/frameworks/check_pipecat.py tests/frameworks/check_livekit.py tests/frameworks/check_examples.py tests/frameworks/check_agent.py \
	    tests/frameworks/check_rtvi.py tests/frameworks/check_livekit_server.py
oracles-voices:
	$(PYTHON) -m venv out/oracles/piper-plus
	out/oracles/piper-plus/bin/python -m pip install --quiet --editable ".[piper-plus]" "onnx>=1.16" "pytest>=8.3"
	out/oracles/piper-plus/bin/python -m pytest -q -p no:cacheprovider -c tests/frameworks/pytest.ini --rootdir=. \
	    tests/frameworks/check_piper_plus.py

# Timings in, FAPs out in WebAssembly. A part of make oracles; the hosted CI runs it alone, in half a minute.
PYODIDE := pyodide@0.24.1 @emscripten-forge/numpy@2.1.1-py311hc8e14bb-0
pyodide: $(VENV)/.ready-dev  ## the core in WebAssembly writes the same bytes; needs npm
	npm install --prefix out/oracles --no-save --no-audit --no-fund $(PYODIDE)
	$(BIN)/python -m tests.oracles.pyodide out/oracles

# Codec and renderer in C; a C compiler builds them, or Zig from the Python package index.
native: $(VENV)/.ready-native  ## build and install codec and renderer in C, which need no OpenGL
	$(BIN)/fapengine doctor | grep renderer

$(VENV)/.ready-native: $(VENV)/.ready $(wildcard native/*.* native/src/* native/fapengine_native/*.py)
	rm -f out/native/fapengine_native-*.whl
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir out/native ./native
	$(BIN)/python -m pip install --quiet --force-reinstall --no-deps out/native/fapengine_native-*.whl
	@touch $@

# For other systems, by Zig from the Python package index: each runs on the version named here and later ones.
NATIVE_TARGETS := x86_64-linux-gnu.2.28 aarch64-linux-gnu.2.28 x86_64-windows-gnu x86_64-macos.11.0 aarch64-macos.11.0
wheels: $(VENV)/.ready  ## wheels of native/ for Linux, Windows and macOS in out/wheels, cross-compiled by Zig
	rm -rf out/wheels
	for target in $(NATIVE_TARGETS); do \
	    FAPENGINE_NATIVE_TARGET=$$target $(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir out/wheels ./native || exit 1; \
	done
	@ls -l out/wheels

# Not published; npm only packs it.
npm: $(VENV)/.ready  ## the package fapengine-face for web pages: out/fapengine-face-VERSION.tgz; needs npm
	$(BIN)/python -m design.face_package out/fapengine-face
	npm pack --silent --pack-destination out ./out/fapengine-face

fresh-machine:
	.ci/fresh-machine

env: $(VENV)/.ready
dev: $(VENV)/.ready-dev
tools: $(VENV)/.ready-tools

$(VENV)/.ready: pyproject.toml .ci/system-packages
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "fapengine needs Python 3.11 or newer; try: make PYTHON=python3.11" >&2; exit 1; }
	.ci/system-packages $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(INSTALL) --editable ".[voice,video,batch,nats,recognizer,recognizer-onnx,lab,live,usd,webrtc,window]"
	$(COMPILE)
	@touch $@

# Its tests are skipped, and counted, where it does not install.
detector: $(VENV)/.ready-detector

$(VENV)/.ready-detector: $(VENV)/.ready
	$(PYTHON) -m venv --without-pip $(VENV)/detector
	$(BIN)/python -m pip --python $(VENV)/detector/bin/python install --quiet --group detector && \
	    $(BIN)/python -m pip --python $(VENV)/detector/bin/python install --quiet --no-deps mediapipe==0.10.21 || \
	    { echo "face detector absent: it does not install here" >&2; rm -rf $(VENV)/detector; }
	@touch $@

$(VENV)/.ready-dev: $(VENV)/.ready $(VENV)/.ready-native
	.ci/system-packages $(PYTHON) tests
	$(INSTALL) --group dev
	$(COMPILE)
	@touch $@

$(VENV)/.ready-docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --group docs
	@touch $@

$(VENV)/.ready-tools: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --group tools
	@touch $@

clean:  ## remove what these commands made, but for out/
	rm -rf $(VENV) .nox out dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
