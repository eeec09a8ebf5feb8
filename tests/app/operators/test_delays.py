"""Guessing gets slower and slower for the address that guesses, and for nobody else."""

import pytest

from app.operators.delays import (
    FIRST_WAIT_S,
    FORGOTTEN_AFTER_S,
    FREE_ATTEMPTS,
    LONGEST_WAIT_S,
    MAX_ADDRESSES,
    Delays,
    TooManyAttemptsError,
)


def waits_of(delays, address):
    with pytest.raises(TooManyAttemptsError) as refusal:
        delays.begin_attempt(address)
    return refusal.value.wait_s


def test_each_wrong_attempt_after_the_free_ones_doubles_the_wait_up_to_the_longest():
    now = [0.0]
    delays, waits = Delays(lambda: now[0]), []
    for _ in range(FREE_ATTEMPTS - 1):
        delays.begin_attempt("1.2.3.4")
    for _ in range(8):
        delays.begin_attempt("1.2.3.4")
        waits.append(waits_of(delays, "1.2.3.4"))
        now[0] += waits[-1]
    assert waits == [10, 20, 40, 80, 160, 300, 300, 300]
    assert (FIRST_WAIT_S, LONGEST_WAIT_S) == (10, 300)
    now[0] += FORGOTTEN_AFTER_S + 1
    for _ in range(FREE_ATTEMPTS):
        delays.begin_attempt("1.2.3.4")


def test_ten_thousand_addresses_lock_out_nobody_else_and_take_no_more_memory():
    delays = Delays(lambda: 0.0)
    for number in range(MAX_ADDRESSES):
        for _ in range(FREE_ATTEMPTS):
            delays.begin_attempt(f"stranger {number}")
    delays.begin_attempt("the operator")
    assert waits_of(delays, f"stranger {MAX_ADDRESSES - 1}") == 10
    assert len(delays._attempts) == MAX_ADDRESSES


def test_a_right_password_ends_the_wait_of_its_address():
    delays = Delays(lambda: 0.0)
    for _ in range(3):
        for _ in range(FREE_ATTEMPTS - 1):
            delays.begin_attempt("1.2.3.4")
        delays.forgive("1.2.3.4")
