# Two commands do everything, set-up included: `make demo` and `make test`.
# One worker a core, each given whole files, so that a file's fixtures are made once and its order holds.
PYTEST := .venv/bin/python -m pytest --numprocesses logical --maxprocesses 8 --dist loadfile

.PHONY: demo test test-slow setup lint docs benchmark clean

demo: setup
	.venv/bin/pecgrasp demo

test: setup lint
	$(PYTEST)

# What takes minutes a test: whole data sets, grids and evaluations. MINUTES=20 begins none after 20 minutes.
test-slow: setup
	$(PYTEST) -m slow --dist load --minutes $(or $(MINUTES),inf)

lint: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/python -m mypy

docs: setup
	.venv/bin/mkdocs build --strict

benchmark: setup
	.venv/bin/pecgrasp benchmark

setup:
	@bash scripts/setup.sh

clean:
	rm -rf .venv demo_output outputs multirun site
