"""What is wrong with a command line is said with the option, the value that was given, and what to do."""

from __future__ import annotations

import sys

import pytest

from softlab import cli

RUN = "run lab-grid --steps 0 --no-judge"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("run", "SCENE is missing: give a name that `softlab scenes` lists, or a .toml file"),
        ("run lab-grid extra", "unexpected argument, or an option that lacks its value: (extra)"),
        ("run lab-grid --steps banana", "--steps = 'banana': must be a whole number"),
        ("run lab-grid --steps=1e3", "--steps = '1e3': must be a whole number"),
        ("run lab-grid --time soon", "--time = 'soon': must be a number"),
        (f"{RUN} --gpus 1.5", "--gpus = '1.5': must be a whole number"),
        ("demo lab-grid --frames x", "--frames = 'x': must be a whole number"),
        ("demo lab-grid --frames 0", "--frames = 0: must be a whole number, at least 1"),
        ("demo lab-grid cloth-flag", "cannot be shown beside lab-grid"),
        ("run lab-grid --time 1e300", "use a shorter time or a larger method.dt"),
        ("run lab-grid --time 1 --steps 2", "--steps and --time are mutually exclusive"),
        (
            f"{RUN} --render x.png --camera 1,2",
            "applies to a scene in space; this one lies in a plane, so leave it out",
        ),
        ("run rope --render x.png --camera 0,90", "--camera = '0,90': pitch must be at most 89"),
        ("run rope --render x.png --camera 1,2,0", "--camera = '1,2,0': size must be greater than 0"),
        (f"{RUN} --render x.png --fps 30", "--fps = 30.0: applies to a clip; add --render FILE.mp4"),
        (f"{RUN} --render x.jpeg", "the name of a picture or a clip must end in .png or .mp4"),
        (f"{RUN} --look skin", "--look skin: applies to tetrahedral bodies and fluids; leave it out"),
        ("run fem-drop --look skin", "--look skin: applies to a picture or a clip; add --render FILE.png"),
        (f"{RUN} --render x.mp4", "a run of 0 steps has no clip; pass --steps N or --time SECONDS"),
        (f"{RUN} --gpus 2", "--gpus = 2: applies to --backend gpu; add it, or use --ranks on CPUs"),
        (f"{RUN} --link nccl", "add --gpus or --ranks"),
        ("advise lab-grid --error -1", "must be a finite number of spacings"),
        ("sweep --kernel fused", "applies to --kernels; add --kernels"),
        ("fluids --peers", "--peers = True: applies to --truth and --rest; add one of them"),
        ("fluids --rest --truth", "--rest = True: cannot be combined with --truth; leave one out"),
        ("fluids --rest --precision float64", "does not apply to --rest; leave one out"),
    ],
)
def test_it_says_what_was_given_and_what_to_do(
    words: str, told: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    monkeypatch.chdir(tmp_path)  # type: ignore[arg-type]
    monkeypatch.setattr(sys, "argv", ["softlab", *words.split()])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert told in error and error.strip().splitlines()[-1].startswith("softlab: ")
