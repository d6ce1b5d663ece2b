"""Fits side by side: in their order, and in threads only where programs have none of their own."""

import threading

import pytest

from faultgauge.identification.optimise.cores import side_by_side

ALONE = "--xla_cpu_multi_thread_eigen=false"


@pytest.mark.parametrize("flags", [ALONE, ""])
def test_results_come_in_the_order_of_the_items(monkeypatch, flags):
    monkeypatch.setenv("XLA_FLAGS", flags)
    done = threading.Event()

    def waits_for_the_last(k):
        if flags and k == 0:
            assert done.wait(60)  # ends only after the last: there are two workers at least
        if k == 3:
            done.set()
        return k * k

    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert side_by_side(waits_for_the_last, range(4)) == [0, 1, 4, 9]


def test_programs_with_threads_of_their_own_go_one_after_another(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    running, most, lock = 0, 0, threading.Lock()

    def counts(_):
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
        threading.Event().wait(0.01)
        with lock:
            running -= 1

    side_by_side(counts, range(8))
    assert most == 1


def test_an_error_reaches_the_caller(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", ALONE)

    def fails(k):
        raise ValueError(f"item {k}")

    with pytest.raises(ValueError, match="item 0"):
        side_by_side(fails, range(3))
