"""python -m tests.mistakes: see the package."""

from __future__ import annotations

import argparse
import sys

from . import __doc__ as about
from .mistake import Mistake
from .run import HANGS, NOTICED, Copy, Result, try_all
from .table import MISTAKES


def main() -> int:
    """The exit status: 0 where every mistake was noticed, 1 where one was not, 2 for bad input, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        "python -m tests.mistakes", description=about, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("words", nargs="*", metavar="NAME", help="only mistakes whose name or file holds one of these")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--near", action="store_true", help="against the tests near by (the default)")
    how.add_argument("--default", action="store_true", help="against the whole default suite")
    parser.add_argument("--list", action="store_true", help="list them, try nothing")
    parser.add_argument(
        "--trust", action="store_true", help="do not look first whether the tests pass without a mistake"
    )
    parser.add_argument("--workers", type=int, default=2, help="how many at a time (2)")
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds for one of them (900)")
    given = parser.parse_args()
    chosen = [m for m in MISTAKES if not given.words or any(word in m.name or word in m.file for word in given.words)]
    if not chosen:
        parser.error(f"no mistake is called {' or '.join(given.words)}; --list names them")
    if given.list:
        for mistake in chosen:
            print(f"{mistake}: {' '.join(mistake.tests)}")
        return 0
    tests = [] if given.default else None
    done: list[Result] = []
    try:
        if not given.trust and not passes(chosen, tests, given.timeout):
            return 2
        try_all(
            chosen, workers=max(1, given.workers), timeout=given.timeout, tests=tests,
            tell=lambda result: (done.append(result), print_result(result)),
        )  # fmt: skip
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        summarise(done, len(chosen))
        return 130
    return summarise(done, len(chosen))


def passes(chosen: list[Mistake], tests: list[str] | None, timeout: float) -> bool:
    """Whether the tests pass as long as nothing is wrong: else they notice nothing."""
    wanted = sorted({test for mistake in chosen for test in mistake.tests}) if tests is None else tests
    print(f"without a mistake: {' '.join(wanted) or 'the default suite'}", flush=True)
    copy = Copy()
    try:
        status, said = copy.run(wanted, timeout * max(1, len(wanted)))
    finally:
        copy.remove()
    if status:
        print(f"{said}\nthese tests fail without a mistake, so that nothing can be said of any", file=sys.stderr)
    return status == 0


def print_result(result: Result) -> None:
    print(f"{result.outcome:9} {result.mistake}: {result.told} [{result.seconds:.0f} s]", flush=True)


def summarise(done: list[Result], wanted: int) -> int:
    missed = [result for result in done if result.outcome not in (NOTICED, HANGS)]
    print(f"{len(done)} of {wanted} mistakes tried, {len(done) - len(missed)} noticed")
    for result in sorted(missed, key=lambda result: result.mistake.name):
        print(f"  {result.outcome}: {result.mistake}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
