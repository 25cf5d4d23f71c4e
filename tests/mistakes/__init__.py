"""Deliberate mistakes, and whether the tests notice them: the measure of what a test suite is worth.

    python -m tests.mistakes                      every mistake, against the tests near by, two at a time
    python -m tests.mistakes bending units        those whose name or file holds one of these words
    python -m tests.mistakes --list               names, files, tests
    python -m tests.mistakes --default            against the whole default suite instead (minutes each)

A mistake is one text of one file replaced by another. It is made in a copy of the sources in a temporary folder, the
tests run there (those near by first as `pytest` runs them, then what of them only `pytest --rest` runs), and the text is
put back; the checkout itself is never written to. Each is noticed where a test that
passes without it fails with it (or hangs, or the code no longer imports).
"""
