"""What a store repeats by itself, and when it gives up."""

from __future__ import annotations

import pytest

from abbe.drivers.link import LinkDownError, LinkError, LinkTimeoutError
from abbe.drivers.stores.base import RefusedError
from abbe.drivers.stores.repeating import Refusal, again, until_up


class BusyError(LinkError):
    """Asks to be asked again."""


class NeverError(LinkError):
    """Refuses."""


class Controller:
    """Answers 1, after errors."""

    def __init__(self, *errors: LinkError) -> None:
        self.errors = list(errors)
        self.recovered: list[LinkError] = []

    async def ask(self) -> int:
        if self.errors:
            raise self.errors.pop(0)
        return 1

    async def recover(self, error: LinkError) -> None:
        self.recovered.append(error)

    async def again(self, attempts: int) -> int:
        return await again(self.ask, attempts, refusal, self.recover)


def refusal(error: LinkError) -> Refusal | None:
    if isinstance(error, BusyError | NeverError):
        return Refusal(f"it says {error}", isinstance(error, NeverError))
    return None


async def test_it_succeeds_after_errors_each_recovered_from():
    errors = LinkTimeoutError("late"), BusyError("busy")
    controller = Controller(*errors)
    assert await controller.again(3) == 1
    assert controller.recovered == list(errors)


async def test_the_last_attempts_error_is_raised_as_it_is():
    controller = Controller(*(LinkTimeoutError(f"late {i}") for i in range(5)))
    with pytest.raises(LinkTimeoutError, match="late 2"):
        await controller.again(3)
    assert len(controller.recovered) == 2


async def test_who_is_busy_at_the_last_attempt_refuses():
    with pytest.raises(RefusedError, match="it says busy"):
        await Controller(*(BusyError("busy") for _ in range(5))).again(3)


@pytest.mark.parametrize("error", [NeverError("no"), RefusedError("it says no")])
async def test_a_refusal_for_good_is_not_asked_again(error: LinkError):
    controller = Controller(error)
    with pytest.raises(RefusedError, match="it says no"):
        await controller.again(3)
    assert controller.recovered == []


async def test_a_link_that_comes_back_is_waited_for():
    looks = iter([False, False, True])
    await until_up(lambda: next(looks), 60.0, lambda: LinkDownError("still down"))
    assert next(looks, None) is None


async def test_a_link_that_stays_down_is_given_up():
    with pytest.raises(LinkDownError, match="still down"):
        await until_up(lambda: False, 0.05, lambda: LinkDownError("still down"))
