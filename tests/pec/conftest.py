"""Trainings that are stopped before they are done."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest

from pec.training.epoch_state import EpochState


@pytest.fixture
def stopped_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], AbstractContextManager[None]]:
    """A context in which a training must be stopped, as by Ctrl-C, once so many epochs are saved."""
    finish = EpochState.finish_epoch

    @contextmanager
    def stopped(epochs: int) -> Iterator[None]:
        def stop(state: EpochState, *figures: Any) -> None:
            finish(state, *figures)
            if state.epoch == epochs:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(EpochState, "finish_epoch", stop)
            with pytest.raises(KeyboardInterrupt):
                yield

    return stopped
