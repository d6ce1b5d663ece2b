# Two commands do all the set-up: `make demo` and `make test`. PYTHON= chooses the interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed-$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')

.PHONY: demo test coverage studies fuzz kills check lint bench claims lock docs constants peers emulators clean

demo: $(STAMP)
	$(BIN)/faultgauge demo --out out

test: $(STAMP)
	$(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m "not study"

# Branches that the tests take; the folders that everything rests on have a bound.
coverage: $(STAMP)
	$(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m "not study" \
		--cov --cov-report=
	$(BIN)/coverage report --sort=cover | tail -40
	for folder in plants telemetry observers detection; do \
		$(BIN)/coverage report --include="*/faultgauge/$$folder/*" --fail-under=95 \
			--format=total || exit 1; \
	done

# Whole studies, on measured and simulated plants: minutes each.
studies: $(STAMP)
	$(BIN)/python -m pytest -q -m study

# Nonsense as logs, plant files, scenarios, streams and models: some minutes, the same every time.
fuzz: $(STAMP)
	FAULTGAUGE_FUZZ=2000 $(BIN)/python -m pytest -q -m fuzz tests/cli/test_fuzz.py

# Every command ended at random moments, 200 in all: half an hour on an idle machine.
kills: $(STAMP)
	$(BIN)/python benchmarks/kills.py

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

check: lint test studies
	$(BIN)/python docs/generate_cli.py --check

docs: $(STAMP)
	$(BIN)/python docs/generate_cli.py

# Every number that was set by hand, by layer, and what it means.
constants: $(STAMP)
	$(BIN)/python docs/constants.py

bench: $(STAMP)
	$(BIN)/python benchmarks/run.py

# The rows of CLAIMS.md that cost little, run again and compared; `--match TEXT` runs any.
claims: $(STAMP)
	$(BIN)/python benchmarks/claims.py

# jax-sysid pins jax<=0.4.31 and scipy<=1.14.1 and so lives apart; `faultgauge benchmark` finds it.
peers:
	$(PYTHON) -m venv .venv-peers
	.venv-peers/bin/pip install --quiet jax-sysid==1.1.0

# What exported C and FMUs are tried with besides: Debian's compilers and emulators (as root), and
# FMPy, which lives apart.
emulators:
	apt-get update
	apt-get install -y --no-install-recommends clang cppcheck gcc-aarch64-linux-gnu \
		libc6-dev-arm64-cross qemu-user gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
	$(PYTHON) -m venv .venv-fmpy
	.venv-fmpy/bin/pip install --quiet fmpy==0.3.32

# The lock holds every package with its hashes, for Python 3.11 to 3.13, and no address.
lock:
	uv pip compile pyproject.toml --group dev --universal --python-version 3.11 \
		--generate-hashes --no-emit-index-url --no-header --quiet -o requirements.lock

# The lock has every dependency, so pip resolves none: newer releases elsewhere cannot stop it.
# hatchling is in the lock, so building needs nothing that is not pinned. What nothing imports is
# never compiled to bytecode.
$(STAMP): requirements.lock pyproject.toml
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --no-deps --no-compile --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

clean:
	rm -rf $(VENV) out build dist
