"""Work on several things at once gives what a loop gives, in its order."""

from __future__ import annotations

import threading

import pytest

from beltcomm import side_by_side as module
from beltcomm.side_by_side import side_by_side


def test_the_answers_stand_in_the_order_of_the_things() -> None:
    second = threading.Event()

    def waits(number: int) -> int:
        if number == 0:
            second.wait(10.0)  # the first is the last to be ready
        elif number == 1:
            second.set()
        return 10 * number

    if module.THREADS > 1:
        assert side_by_side(waits, range(5)) == [0, 10, 20, 30, 40]
    assert side_by_side(str, [7]) == ["7"]


def test_work_within_work_takes_no_further_thread() -> None:
    names = side_by_side(lambda _: side_by_side(lambda _: threading.current_thread().name, range(3)), range(4))
    assert all(len(set(inner)) == 1 for inner in names)


def test_one_error_is_that_of_the_loop() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda number: 1 / number, [1, 0, 2])
