# harmzone: what a person or CI does with this repository. `make` alone lists it.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
# The recipes of one target run in order; cargo and harmzone use all cores by themselves.
.NOTPARALLEL:

BIN = $(or $(CARGO_TARGET_DIR),target)/release/harmzone
XTASK = cargo run --release -p xtask --
PYTHON_SOURCES = python scenes mjcf_assets tests scripts xtask/python

RESULTS = runs/results
ABLATIONS = runs/ablations

.PHONY: help setup setup-test setup-golden build demo network-data network other-seed network-seed network-rivals network-kinds-seed results beside-results ablations drives report test ci book test-book check-gpu check-logs \
	check-mmdet3d bench bench-micro bench-gen bench-eval race miri asan bundle bundle-test wheel wheel-test wheel-root-test bench-ray bench-stream paper-run gallery weathers reference \
	soak lock sbom audit reproducible fmt clean

help: ## List the targets
	@echo "make <target>, where target is:"
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: .venv/.ready ## Python venv with the pinned MuJoCo, and Mesa's EGL (once; later runs are instant)

.venv/.ready: requirements.txt scripts/setup.sh
	@scripts/setup.sh product

setup-test: .venv-test/.ready ## The outside references that the tests compare with (once)

.venv-test/.ready: requirements.txt requirements-test.txt scripts/setup.sh .venv/.ready
	@scripts/setup.sh test

setup-golden: .venv-golden/.ready ## PyTorch, which the golden tests' files and `make race` come from (once; large)

.venv-golden/.ready: tests/golden/requirements.txt tests/golden/requirements-cuda.txt scripts/setup.sh
	@scripts/setup.sh golden

.venv-logs/.ready: requirements.txt requirements-test.txt tests/import/requirements.txt scripts/setup.sh .venv/.ready
	@scripts/setup.sh logs

.venv-mmdet3d/.ready: tests/golden/requirements.txt tests/golden/requirements-cuda.txt tests/import/requirements-mmdet3d.txt scripts/setup.sh
	@scripts/setup.sh mmdet3d

.venv-wheel/.ready: requirements-wheel.txt scripts/setup.sh .venv/.ready
	@scripts/setup.sh wheel

.venv-bundle/.ready: requirements-bundle.txt requirements-bundle-source.txt scripts/setup.sh .venv/.ready
	@scripts/setup.sh bundle

.venv-supply/.ready: requirements-supply.txt scripts/setup.sh .venv/.ready
	@scripts/setup.sh supply

build: setup ## The optimised program (the first time 8 to 14 minutes on two cores)
	@start=$$SECONDS; cargo build --release; \
	echo "built $(BIN) in $$((SECONDS - start)) s"

demo: ## Everything, small: generate, label, train, score, draw; results in demo/
	@scripts/demo.sh

HEADLINE = $(if $(wildcard $(NETWORK)/run/model.safetensors),--headline $(NETWORK)/run \
    $(patsubst %/model.safetensors,--headline-again %,$(sort $(wildcard $(NETWORK)/seed-*/model.safetensors))))

RESULTS_OF = $(XTASK) results $(if $(filter --headline --headline=% --headline-again%,$(ARGS)),,$(HEADLINE)) $(ARGS)

results: setup ## RESULTS.md and the report of the network that ships, its seeds and rivals; after `make network`; may be stopped and called again
	$(RESULTS_OF) --config configs/results.toml --out $(RESULTS)
	cp $(RESULTS)/RESULTS.md RESULTS.md
	@echo "the report: $(RESULTS)/report.html"

beside-results: build ## What RESULTS.md lacks of split test, after `make results ARGS=--final`: each group of towns, older networks, open-set scores; resumable
	NETWORK=$(NETWORK) RESULTS=$(RESULTS) scripts/beside_results.sh

ablations: setup ## ABLATIONS.md from nothing: data, many short trainings, scores; hours, may be stopped and called again
	$(RESULTS_OF) --config configs/ablations.toml --out $(ABLATIONS)
	cp $(ABLATIONS)/RESULTS.md ABLATIONS.md

# How the network inside the program came about; the same bytes on the CPU it was trained on (docs/detector.md).
NETWORK = runs/network
TOWN_DRIVES = --preset small --set sample_period_s=0.9 --episodes 1000 --samples 12 --seed 81001 --set val_every=0
# As often as `drive` looks: false alarms a kilometre are of all samples on the way.
CHOOSING = --preset small --set sample_period_s=0.3 --episodes 84 --samples 24 --seed 72002 --set val_every=1

SCHEDULE = --set products=bf16 --set fused_stage.epochs=8 --set validate_every_epochs=0

network-data: build
	$(BIN) gen --out $(NETWORK)/train $(TOWN_DRIVES) --set scene.random_solids=24 --set scene.rebuilt_share=0.7
	$(BIN) gen --out $(NETWORK)/val $(CHOOSING)
	$(BIN) label $(NETWORK)/train
	$(BIN) label $(NETWORK)/val

network: network-data ## The network inside the program, from nothing: data, training, the score it warns from; hours, resumable
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/run $(SCHEDULE)
	$(BIN) calibrate $(NETWORK)/run --data $(NETWORK)/val
	@cmp $(NETWORK)/run/model.safetensors models/small.safetensors || { echo "the last digits of a training are its CPU's:" \
	    "models/small.md names the one that models/small.safetensors is of" >&2; exit 1; }
	@echo "models/small.safetensors, to the byte"

# Before data are made, which takes long.
other-seed:
	@case "$(SEED)" in ""|0) echo "SEED=1 trains from seed 1; 0 is that of \`make network\` and \`make network-rivals\`" >&2; exit 2;; esac

network-seed: other-seed network-data ## The same training from another seed; `make results` sets it beside the network. SEED=1
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/seed-$(SEED) $(SCHEDULE) --set seed=$(SEED)
	$(BIN) calibrate $(NETWORK)/seed-$(SEED) --data $(NETWORK)/val

# What `drive` and `versus` measure the network against: trained on the same drives, as long, with the same disturbances.
LIDAR_ALONE = --set model.use_camera=false --set lidar_stage.epochs=8 --set fused_stage.epochs=0
CLOSED_SET = --set model.head.classes=kind --set model.head.numeric_fusion=none --set model.head.judge=network

CAMERA_ALONE = --set model.use_lidar=false

network-rivals: network-data ## LiDAR alone, the camera alone and a closed set of kinds, trained as the network was: rivals for `drive` and `versus`; hours, resumable
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/lidar $(SCHEDULE) $(LIDAR_ALONE)
	$(BIN) calibrate $(NETWORK)/lidar --data $(NETWORK)/val
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/kinds $(SCHEDULE) $(CLOSED_SET)
	$(BIN) calibrate $(NETWORK)/kinds --judge zone-expected --data $(NETWORK)/val
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/camera $(SCHEDULE) $(CAMERA_ALONE)
	$(BIN) calibrate $(NETWORK)/camera --data $(NETWORK)/val

network-kinds-seed: other-seed network-data ## The closed set of kinds from another seed, as its figures come near to the network's; hours, resumable. SEED=1
	$(BIN) train $(NETWORK)/train --out $(NETWORK)/kinds-$(SEED) $(SCHEDULE) $(CLOSED_SET) --set seed=$(SEED)
	$(BIN) calibrate $(NETWORK)/kinds-$(SEED) --judge zone-expected --data $(NETWORK)/val

drives: setup build ## The closed loop in drawn worlds and in the suite, as in docs/drive.md, after `make network-rivals`; hours, resumable; DRIVES_FINAL=1, DRIVES_SCORES=1
	@scripts/drives.sh

# What `make report` scores: a run, or `small`, the network inside the program; and both data sets.
REPORT_RUN ?= small
REPORT_ID ?= $(RESULTS)/id
REPORT_OOD ?= $(RESULTS)/ood
REPORT = runs/report

report: build ## The report of any run: runs/report/report.html; REPORT_RUN=RUN REPORT_ID=DIR REPORT_OOD=DIR
	$(BIN) eval $(REPORT_RUN) --data $(REPORT_ID) --out $(REPORT)/id --force
	$(BIN) eval $(REPORT_RUN) --data $(REPORT_OOD) --ood --out $(REPORT)/ood --force
	$(BIN) sweep $(REPORT_RUN) --data $(REPORT_ID) --out $(REPORT)/id --force
	$(BIN) sweep $(REPORT_RUN) --data $(REPORT_OOD) --out $(REPORT)/ood --force
	$(BIN) report $(REPORT)/report.html --id $(REPORT)/id --ood $(REPORT)/ood \
	    $(if $(wildcard $(RESULTS)/results.json),--results $(RESULTS)/results.json) --force

test: setup setup-test ## All tests
	cargo test --release --workspace
	@scripts/pytest.sh

# Built from source: 5 minutes on two cores, once.
CARGO_DENY_VERSION = 0.20.2
CARGO_DENY = $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/harmzone/cargo-deny-$(CARGO_DENY_VERSION)/bin/cargo-deny

$(CARGO_DENY):
	env -u CARGO_TARGET_DIR cargo install --locked --quiet cargo-deny --version =$(CARGO_DENY_VERSION) \
	    --no-default-features --root $(@D:/bin=)

ci: setup setup-test $(CARGO_DENY) ## Tests, formats, lints, docs, spelling, licences: all that must hold before a merge
	cargo fmt --all --check
	.venv-test/bin/ruff format --check $(PYTHON_SOURCES)
	.venv-test/bin/ruff check $(PYTHON_SOURCES)
	.venv-test/bin/typos
	$(CARGO_DENY) check bans licenses sources
	AUDIT=offline scripts/audit.sh $(CARGO_DENY)
	cargo clippy --release --workspace --all-targets -- -D warnings
	cargo clippy --release --lib --no-default-features --features wheel -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --document-private-items
	@$(MAKE) --no-print-directory test
	@$(MAKE) --no-print-directory test-book

# Built from source, without its server: a minute on two cores, once.
MDBOOK_VERSION = 0.5.4
MDBOOK = $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/harmzone/mdbook-$(MDBOOK_VERSION)/bin/mdbook

$(MDBOOK):
	env -u CARGO_TARGET_DIR cargo install --locked --quiet mdbook --version =$(MDBOOK_VERSION) \
	    --no-default-features --features search --root $(@D:/bin=)

book: $(MDBOOK) ## The book of docs/: dist/book/index.html
	$(MDBOOK) build

# The book's links are checked where `make book` has been called.
test-book: build setup-test ## The commands that README.md and the book show, run, and the book's links; 2 to 3 minutes. ARGS=docs/look.md
	$(if $(wildcard $(MDBOOK)),$(MDBOOK) build)
	.venv-test/bin/python scripts/test_book.py --program $(BIN) $(if $(wildcard $(MDBOOK)),--book dist/book) $(ARGS)

check-gpu: setup ## The GPU backends compile, without a GPU; minutes
	cargo clippy --release --features vulkan,cuda -- -D warnings

# Outputs of the checks, and the samples of KITTI and Argoverse 2 (without them their checks are skipped).
LOGS = runs/logs
LOG_SAMPLES ?= ../shared/samples

check-logs: build .venv-logs/.ready ## Importers and exporters against the data sets' own toolkits; minutes; LOG_SAMPLES=DIR
	.venv-logs/bin/python tests/import/run_all.py $(BIN) --work $(LOGS) --samples $(LOG_SAMPLES) $(ARGS)

check-mmdet3d: build .venv-logs/.ready .venv-mmdet3d/.ready ## And mmdetection3d's own preparation over the exports (3 GB of PyTorch)
	.venv-logs/bin/python tests/import/run_all.py $(BIN) --work $(LOGS) --samples $(LOG_SAMPLES) \
	    --mmdet3d .venv-mmdet3d/bin/python $(ARGS)

# What is raced needs `make setup-test` and `make setup-golden`; rows that miss theirs are told as absent.
bench: setup ## All speeds in one table, beside what is wanted; fails below a floor. ROWS=label,eval JSON=FILE FULL=1 FEATURES=cuda
	cargo run --release -p xtask $(if $(FEATURES),--features $(FEATURES)) -- bench $(if $(ROWS),--rows $(ROWS)) \
	    $(if $(JSON),--json $(JSON)) $(if $(FULL),--train-in runs/bench) --data $(RACE_DATA) $(ARGS)

bench-micro: setup ## Benchmarks of single operations, module/case/size; never a gate
	cargo bench --profile release

bench-gen: setup ## Speed of gen against bare MuJoCo, of two processes against one, memory, disk; about 15 minutes
	$(XTASK) bench-gen --town all
	$(XTASK) bench-gen --town all --weather all --episodes 18 --run-samples 240 # what weather adds

# The race's labelled dataset and its checkpoint or run folder; `small` is the network inside the program.
RACE_DATA ?= data/race
RACE_MODEL ?= small

race: build setup-golden ## Speed of the small detector, and against PyTorch; RACE_DATA=DIR RACE_MODEL=RUN
	@test -d $(RACE_DATA) || { $(BIN) gen --town downtown --samples 30 --episodes 8 --seed 7 --set val_every=2 \
	    --out $(RACE_DATA) && $(BIN) label $(RACE_DATA); }
	RAYON_NUM_THREADS=2 $(XTASK) bench-model --data $(RACE_DATA) --model $(RACE_MODEL)
	.venv-golden/bin/python scripts/race_pytorch.py $(dir $(BIN))xtask $(RACE_DATA) --model $(RACE_MODEL)

bench-eval: setup setup-test ## Speed of eval against nuscenes-devkit and of label against shapely; about 3 minutes
	$(XTASK) bench --rows label,eval

# Neither a time nor a folder of this machine gets into what others get: `make reproducible` holds the wheel and the bundle to that.
# With these flags every crate is compiled once more, the first time.
MOVABLE = env SOURCE_DATE_EPOCH=$(or $(SOURCE_DATE_EPOCH),$(shell git log -1 --format=%ct 2>/dev/null),315532800) \
	CARGO_INCREMENTAL=0 HARMZONE_MOVABLE=1 RUSTFLAGS="$${RUSTFLAGS:-} --remap-path-prefix=$(CURDIR)=/harmzone \
	--remap-path-prefix=$${CARGO_HOME:-$$HOME/.cargo}=/cargo --remap-path-prefix=$(abspath $(or $(CARGO_TARGET_DIR),target))=/target"

BUNDLE = dist/harmzone-x86_64-linux

# scripts/bundle.toml and these make the program smaller: equal functions are in it once, and no relocations.
bundle: setup .venv-bundle/.ready ## One folder that runs on other x86-64 Linux machines, at most 76 MiB: dist/
	$(MOVABLE) cargo rustc --locked --config scripts/bundle.toml --release --bin harmzone -- \
	    -C relocation-model=static -C link-arg=-Wl,--icf=all
	PYTHONHASHSEED=0 .venv-bundle/bin/python scripts/bundle.py $(BIN) $(BUNDLE)

# ROOT is the root folder of any other Linux, such as an unpacked container image; as root, with unshare and chroot.
ROOT ?= dist/debian

bundle-test: ## The bundle from gen to eval in a Debian that has neither Rust, Python nor network; some minutes
	@test -d $(BUNDLE) || $(MAKE) bundle
	.venv-bundle/bin/python scripts/try_bundle.py $(BUNDLE) $(ROOT)

WHEELS = dist/wheels

# For any CPython from 3.11 on; pip finds MuJoCo and numpy.
wheel: setup .venv-wheel/.ready sbom ## A wheel of the command and the Python module: dist/wheels (15 minutes on two cores, the first time)
	rm -rf $(WHEELS)
	$(MOVABLE) .venv-wheel/bin/maturin build --release --locked --interpreter .venv/bin/python --sbom-include $(SBOM) \
	    --out $(WHEELS)

wheel-test: build wheel ## The wheel in a fresh venv: command, module, the program's bytes; PyTorch's part after `make setup-golden`
	@scripts/try_wheel.sh $(WHEELS) $(BIN)

wheel-root-test: build wheel ## The wheel from gen to eval in a bare Debian that has neither Rust nor network; as root, some minutes
	.venv-wheel/bin/python scripts/try_wheel_root.py $(WHEELS) $(BIN) dist/debian-python

bench-ray: build wheel ## What two raylets gain over one process, with one killed; some ten minutes of a quiet machine
	@scripts/try_wheel.sh $(WHEELS) $(BIN) scripts/bench_ray.py

bench-stream: setup ## Time and memory of a made-up data set of 100,000 episodes, of which 10,000 are streamed; some minutes. ARGS="--entries 1000"
	$(XTASK) bench-stream $(ARGS)

paper-run: setup ## The paper's data, training, scores and costs on a GPU, resumable; PAPER_DEVICE=cuda:0 PAPER_TOY=1 tries it on the CPU
	@scripts/paper_run.sh

# Each row alone is ROWS=kills, bits, io_errors, io_others, disk_full, doctor or soak; HARMZONE_FAULTS=100 makes fewer (soak: minutes).
soak: setup setup-test ## Thousands of kills, changed bits, errors of the disk, and full disks, and two hours of gen whose workers die: seven tables, some hours
	cargo test --release --test faults -- --ignored --nocapture --test-threads 1 long_$(ROWS)

miri: ## The kernels under Miri, portable path: cargo +nightly with the component miri; minutes
	cd tests/miri && MIRIFLAGS="-Zmiri-tree-borrows -Zmiri-ignore-leaks" cargo +nightly miri test -- --test-threads=1

asan: ## The kernels under AddressSanitizer, with all instruction sets of this CPU: cargo +nightly; a minute
	cd tests/miri && RUSTFLAGS=-Zsanitizer=address cargo +nightly test --release --target x86_64-unknown-linux-gnu

gallery: setup-test ## Pictures of all object models: docs/gallery.png, docs/gallery_test.png
	.venv-test/bin/python mjcf_assets/make_gallery.py

weathers: build setup-test ## One frame in all weathers, on camera and LiDAR: docs/pictures/weather*
	.venv-test/bin/python scripts/weather_sheet.py $(BIN) data/weathers

reference: build ## The pages of the docs that the program prints: docs/reference
	mkdir -p docs/reference
	$(BIN) man --markdown > docs/reference/commands.md
	$(BIN) config reference > docs/reference/config.md
	.venv/bin/python scripts/python_reference.py > docs/reference/python.md

# The venv may be older than its list: else a pin of the tool itself could not be raised.
lock: ## Hashes behind every pin of the requirements files, from the package index; ARGS=requirements.txt
	@test -x .venv-supply/bin/uv || $(MAKE) --no-print-directory .venv-supply/.ready
	.venv-supply/bin/python scripts/lock_requirements.py $(ARGS)

# Built from source: some minutes on two cores, once.
CARGO_CYCLONEDX_VERSION = 0.5.9
CARGO_CYCLONEDX = $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/harmzone/cargo-cyclonedx-$(CARGO_CYCLONEDX_VERSION)/bin/cargo-cyclonedx

$(CARGO_CYCLONEDX):
	env -u CARGO_TARGET_DIR cargo install --locked --quiet cargo-cyclonedx --version =$(CARGO_CYCLONEDX_VERSION) \
	    --root $(@D:/bin=)

SBOM = dist/sbom/harmzone.cdx.json

sbom: setup .venv-supply/.ready $(CARGO_CYCLONEDX) ## All crates and packages with versions, hashes and licences, as CycloneDX: dist/sbom
	.venv-supply/bin/python scripts/sbom.py $(CARGO_CYCLONEDX) $(SBOM)

audit: $(CARGO_DENY) ## Known faults of the crates, from RustSec's database; AUDIT=offline fetches none, AUDIT=required fails without one
	@AUDIT=$(AUDIT) scripts/audit.sh $(CARGO_DENY)

reproducible: ## Wheel and bundle twice, in two clones: the same bytes? An hour or more; ARGS=wheel JOBS=1 KEEP=1
	@JOBS=$(JOBS) KEEP=$(KEEP) scripts/check_reproducible.sh $(ARGS)

fmt: setup-test ## Format Rust and Python
	cargo fmt --all
	.venv-test/bin/ruff format $(PYTHON_SOURCES)
	.venv-test/bin/ruff check --fix $(PYTHON_SOURCES)

clean: ## Remove the venvs, the bundle and the demo's results (not the compiled code)
	rm -rf .venv .venv-test .venv-golden .venv-bundle .venv-wheel .venv-supply demo dist
