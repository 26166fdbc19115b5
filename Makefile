# Two commands do everything, set-up included: `make demo` and `make test`.
.PHONY: demo test setup lint benchmark clean

demo: setup
	.venv/bin/python scripts/demo.py

test: setup lint
	.venv/bin/python -m pytest

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/python -m mypy

benchmark: setup
	.venv/bin/python scripts/benchmark.py

setup:
	@bash scripts/setup.sh

clean:
	rm -rf .venv demo_output outputs multirun
