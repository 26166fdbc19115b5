# Two commands do everything, set-up included: `make demo` and `make test`.
.PHONY: demo test setup lint benchmark clean

demo: setup
	.venv/bin/pecgrasp demo

test: setup lint
	.venv/bin/python -m pytest

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/python -m mypy

benchmark: setup
	.venv/bin/pecgrasp benchmark

setup:
	@bash scripts/setup.sh

clean:
	rm -rf .venv demo_output outputs multirun
