# Everything happens in .venv and target; nothing else on the machine is touched.
PYTHON ?= python3
BIN := .venv/bin
SOURCES := $(shell find rust/src -name '*.rs') Cargo.toml Cargo.lock pyproject.toml
TARGET := $(abspath $(or $(CARGO_TARGET_DIR),target))
EXTENSION = $(shell sed -n 's/^module-name = "\(.*\)"/\1/p' pyproject.toml)

export PYO3_PYTHON := $(CURDIR)/$(BIN)/python
export VIRTUAL_ENV := $(CURDIR)/.venv
export PATH := $(CURDIR)/$(BIN):$(PATH)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_QUIET := 1
# Property tests try the same cases everywhere; `make fuzz` looks for new ones.
export PROPTEST_RNG_SEED ?= 2017
unexport CONDA_PREFIX PYTHONPATH PYTHONHOME

.PHONY: help demo recordings test test-rust test-python virtual test-usb-kernel aarch64 bench measures fuzz lint format clean

help:  ## what can be made
	@sed -n 's/^\([a-z0-9-]*\):[^#]*## \(.*\)/make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

demo: .venv/.installed  ## build, install into .venv, and watch six throws over a floor and a box of glass
	@physinc run demo

recordings:  ## make the packaged demo and fixtures/ anew, byte for byte
	cargo run --release --locked --example recordings

test: test-rust test-python  ## every test, Rust's and Python's

test-rust: virtual
	VIRTUAL_KINECT=$(TARGET)/release/virtual-kinect cargo test --locked --features usb
	cargo test --locked --release --test instructions

test-python: .venv/.installed
	python -m pytest

virtual:  ## target/release/virtual-kinect, which runs a program beside a Kinect that isn't there
	cargo build --release --locked --manifest-path rust/virtual/Cargo.toml --target-dir $(TARGET)

test-usb-kernel: .venv/.installed virtual  ## the driver on a real kernel's usbfs, in a guest of QEMU (what it needs: tests/usb_kernel/run)
	tests/usb_kernel/run

aarch64:  ## the library on aarch64 under qemu-user: tests, instructions a frame (what it needs: rust/tests/aarch64/count)
	rust/tests/aarch64/count

bench: .venv/.bench  ## time: a frame beside memcpy, the chain from packed bytes beside numpy and OpenCV
	cargo bench --locked --bench speed
	OPENBLAS_NUM_THREADS=1 python benches/numpy_chain.py

measures: .venv/.tools  ## accuracy of simulated scenes, against their truth
	cargo bench --locked --bench accuracy
	cargo bench --locked --bench tracks

fuzz:  ## a minute of each fuzz target (SECONDS=60), then the property tests on new cases
	rust/fuzz/run $(or $(SECONDS),60)
	env -u PROPTEST_RNG_SEED PROPTEST_CASES=2000 cargo test --locked --release --lib --test assembler --test reasoning --test seeing

lint: .venv/.installed  ## formats, clippy, rustdoc, ruff, mypy and stubtest; warnings are errors
	cargo fmt --check
	cargo fmt --check --manifest-path rust/nostd/Cargo.toml
	cargo fmt --check --manifest-path rust/fuzz/Cargo.toml
	cargo fmt --check --manifest-path rust/virtual/Cargo.toml
	cargo clippy --locked --all-targets --features usb -- -D warnings
	cargo clippy --locked --lib --no-default-features -- -D warnings
	cargo clippy --locked --lib --features python -- -D warnings
	cargo clippy --locked --manifest-path rust/virtual/Cargo.toml --target-dir $(TARGET) -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --quiet --no-deps --features usb
	ruff check
	ruff format --check
	mypy
	python -m mypy.stubtest $(EXTENSION)

format: .venv/.tools  ## format Rust and Python
	cargo fmt
	ruff format
	ruff check --fix

clean:  ## remove .venv and target
	cargo clean
	rm -rf .venv

.venv/.python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo 'physinc needs Python 3.10 or newer: make PYTHON=python3.12 …' >&2; exit 1; }
	$(PYTHON) -m venv .venv
	@touch $@

.venv/.tools: .venv/.python requirements-dev.txt
	python -m pip install --requirement requirements-dev.txt
	@touch $@

.venv/.bench: .venv/.installed requirements-bench.txt
	python -m pip install --requirement requirements-bench.txt
	@touch $@

# Python's own sources are linked, not copied: only Rust is built anew.
.venv/.installed: .venv/.tools $(SOURCES)
	maturin develop --release --locked
	@touch $@
