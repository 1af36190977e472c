# Abbe: `make demo` runs the main job, `make test` the tests; each sets itself up from nothing.
SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3
DEBIAN := mbpoll socat chromium fonts-dejavu-core linuxcnc-uspace systemd libfaketime \
  mmdebstrap e2fsprogs dpkg-dev iproute2
MACHINE := qemu-system-x86 mmdebstrap e2fsprogs dpkg-dev
PROMETHEUS := $(VENV)/unpacked/usr/bin/prometheus
MOSQUITTO := $(VENV)/unpacked/usr/sbin/mosquitto
POSTGRESQL := $(VENV)/unpacked/postgresql
NODE_OPCUA := $(VENV)/opcua/node_modules/.package-lock.json
SPARKPLUG := $(VENV)/sparkplug/node_modules/.package-lock.json
BENCHMARKS := cycle compensator campaign fit tables links screening diagnosis_command diagnosis check_points plan validation fleet spreading plant
SOURCES := compcore drivers daemon tests benchmarks examples

# What is imported by one process of the tests is compiled for all others.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo demo-calibrate demo-fleet test test-thorough lint types fast bench torment soak deb test-systemd test-calibration docs clean

define install_debian
missing=; for package in $(1); do \
  dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; done; \
if [ -n "$$missing" ]; then \
  echo "Installing Debian packages for the tests:$$missing"; \
  run=; [ "$$(id -u)" = 0 ] || run=sudo; \
  $$run apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$run apt-get install -y -qq --no-install-recommends $$missing >/dev/null; fi
endef

help: ## Show what there is
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*##/\t/' | expand -t 14

demo-calibrate: $(VENV)/.dev ## The simulated machine calibrated, from plan to certificate, by nobody (10 min)
	@PYTHONPATH=. $(BIN)/python -m benchmarks.calibrate

demo: $(VENV)/.runtime ## See a coordinate measuring machine become ten times more accurate
	@$(BIN)/abbe demo

demo-fleet: $(VENV)/.fleet $(POSTGRESQL) $(MOSQUITTO) $(PROMETHEUS) ## See a small plant: three machines, one of which begins to drift (docs/fleet.md)
	@$(BIN)/python -m tools.demo_fleet $(if $(STAY),--seconds $(STAY))

# Beside each other: what is downloaded for the tests; the types, and the tests compiled once for all processes.
test: $(BIN)/python ## Run all checks and tests
	@$(MAKE) --no-print-directory $(VENV)/.debian & debian=$$!; \
	$(MAKE) --no-print-directory $(VENV)/.dev && { \
	  $(BIN)/pytest --collect-only -q >/dev/null 2>&1 & compiled=$$!; \
	  $(MAKE) --no-print-directory lint types; checked=$$?; \
	  wait $$compiled; wait $$debian && [ $$checked = 0 ]; }
	$(BIN)/pytest -n 4 --dist loadgroup --no-loadscope-reorder

test-thorough: $(VENV)/.dev $(VENV)/.debian ## Run more cases of what `make test` runs some of, and the soak (a quarter of an hour)
	$(BIN)/pytest -n 3 --dist loadgroup --no-loadscope-reorder -m thorough

fast: $(VENV)/.dev ## The tests that need no other process
	$(BIN)/pytest -m "not integration and not thorough" -q

lint: $(VENV)/.dev ## ruff, and the direction of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/.dev ## mypy --strict
	$(BIN)/mypy

bench: $(VENV)/.bench ## Measure speed, and how good it is, beside others (two hours); writes docs/performance.md, validation.md
	@failed=; for script in $(BENCHMARKS); do \
	  echo "== benchmarks/$$script.py"; \
	  PYTHONPATH=. $(BIN)/python benchmarks/$$script.py || failed="$$failed $$script"; done; \
	[ -z "$$failed" ] || { echo "Failed:$$failed"; exit 1; }

SECONDS ?= 3600
SEED ?= 1
torment: $(VENV)/.dev ## Torment every protocol of a live run, an hour in all (SECONDS=, SEED=); docs/torment.md
	$(BIN)/python -m abbe.drivers.simulated.torment --seconds $(SECONDS) --seed $(SEED)

soak: $(VENV)/.dev $(VENV)/.debian ## Soak a supervised run in faults of wire and computer (SECONDS=180, SEED=); docs/soak.md
	$(BIN)/python -m abbe.drivers.simulated.soak --seconds $(if $(filter file,$(origin SECONDS)),180,$(SECONDS)) --seed $(SEED)

deb: $(VENV)/.runtime ## Build dist/abbe_VERSION_amd64.deb, which is installed without a network
	@$(BIN)/python -m tools.deb

test-systemd: $(VENV)/.dev ## Prove the .deb and its services on a real systemd in a virtual machine (half an hour; CONTAINER=1: minutes)
	@$(call install_debian,$(MACHINE))
	$(BIN)/python -m tests.systemd $(if $(CONTAINER),--container)

test-calibration: $(VENV)/.dev $(VENV)/.debian ## Calibrate a real LinuxCNC from plan to certificate, and have it touch (ten minutes)
	$(BIN)/pytest -m calibration tests/drivers/linuxcnc

clean: ## Remove everything that the other targets made
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis demo-out

$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || { echo "Abbe needs Python 3.11 or later; $(PYTHON) was not found."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Abbe needs Python 3.11 or later; $(PYTHON) is older. Try: make PYTHON=python3.11 …"; exit 1; }
	@echo "Setting up Python packages in $(VENV) (once, about a minute) …"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.runtime: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.fleet: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[fleet,http,mqtt]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.bench: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,bench]'
	@touch $@ $(VENV)/.dev $(VENV)/.runtime

# Unrelated clients and a browser for the integration tests: Debian packages.
$(VENV)/.debian: Makefile | $(BIN)/python $(PROMETHEUS) $(MOSQUITTO) $(POSTGRESQL) $(NODE_OPCUA) $(SPARKPLUG)
	@$(call install_debian,$(DEBIAN))
	@touch $@

# Unpacked, not installed: Debian's package would run it as a service.
$(PROMETHEUS):
	@echo "Unpacking Prometheus for the tests …"; mkdir -p $(VENV)/unpacked; cd $(VENV)/unpacked; \
	run=; [ "$$(id -u)" = 0 ] || run=sudo; rm -f prometheus_*.deb; \
	apt-get download -qq prometheus 2>/dev/null || { $$run apt-get update -qq && apt-get download -qq prometheus 2>/dev/null; }; \
	dpkg-deb --fsys-tarfile prometheus_*.deb | tar -xm ./usr/bin && rm prometheus_*.deb

# A broker, unpacked likewise, with the libraries that Debian has it stand on.
$(MOSQUITTO):
	@echo "Unpacking Mosquitto for the tests …"; mkdir -p $(VENV)/unpacked; cd $(VENV)/unpacked; \
	run=; [ "$$(id -u)" = 0 ] || run=sudo; needed="mosquitto libmosquitto1 libcjson1 libdlt2 libwrap0"; \
	for package in $$needed; do rm -f "$$package"_*.deb; done; \
	apt-get download -qq $$needed 2>/dev/null || { $$run apt-get update -qq && apt-get download -qq $$needed 2>/dev/null; }; \
	for package in $$needed; do dpkg-deb --fsys-tarfile "$$package"_*.deb | tar -xm ./usr && rm "$$package"_*.deb || exit 1; done

# A database server, of the version that Debian has; what its just-in-time compiler stands on is left out.
$(POSTGRESQL):
	@echo "Unpacking PostgreSQL for the tests …"; mkdir -p $(VENV)/unpacked; cd $(VENV)/unpacked; \
	run=; [ "$$(id -u)" = 0 ] || run=sudo; \
	apt-cache depends postgresql 2>/dev/null | grep -q Depends || $$run apt-get update -qq; \
	server=$$(apt-cache depends postgresql | grep -o 'postgresql-[0-9]*$$' | head -1); \
	needed="$$server postgresql-client-$${server##*-} $$(apt-cache depends $$server | sed -n 's/^ *Depends: \(lib[a-z].*\)/\1/p' | grep -v 'llvm\|libc6\|gcc\|stdc++\|systemd')"; \
	for package in $$needed; do rm -f "$$package"_*.deb; done; \
	apt-get download -qq $$needed 2>/dev/null || { $$run apt-get update -qq && apt-get download -qq $$needed 2>/dev/null; }; \
	for package in $$needed; do dpkg-deb --fsys-tarfile "$$package"_*.deb | tar -xm ./usr ./lib 2>/dev/null; rm "$$package"_*.deb || exit 1; done; \
	ln -s usr/lib/postgresql/$${server##*-} postgresql

# An OPC UA server that is not Abbe's.
$(NODE_OPCUA): tests/support/drivers/opcua/package.json | $(BIN)/python
	@echo "Installing node-opcua for the tests …"; mkdir -p $(VENV)/opcua && cp $< $(VENV)/opcua/ && \
	npm install --prefix $(VENV)/opcua --no-audit --no-fund --no-package-lock --silent && touch $@

# A decoder of Sparkplug B that is not Abbe's.
$(SPARKPLUG): tests/support/daemon/sparkplug/package.json | $(BIN)/python
	@echo "Installing sparkplug-payload for the tests …"; mkdir -p $(VENV)/sparkplug && cp $< $(VENV)/sparkplug/ && \
	npm install --prefix $(VENV)/sparkplug --no-audit --no-fund --no-package-lock --ignore-scripts --silent && touch $@
