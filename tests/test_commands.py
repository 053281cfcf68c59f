"""`python -m agents`: what every command says to a bad argument, and that it says it before anything is run."""

from typing import Any

import pytest

from agents.__main__ import COMMANDS, main
from agents.compare import command as compare
from agents.honesty import command as consistency


def test_every_command_tells_its_options(capsys: pytest.CaptureFixture[str]) -> None:
    for command in COMMANDS:
        with pytest.raises(SystemExit) as exit_:
            main([command, "--help"])
        assert exit_.value.code == 0
        assert ("--save" if command == "watch" else "--out") in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("compare --policies nobody", "nobody"),
        ("compare --scenario nowhere", "nowhere"),
        ("compare --duration -1", "duration"),
        ("consistency --initialisations guess", "guess"),
        ("consistency --policies nobody", "nobody"),
        ("watch --policy absent --tum unused", "policy: 'absent' is unknown"),
        ("watch --save clip.avi --tum unused", "save must end in .gif"),
        ("watch --every 0 --tum unused", "every must be positive, got 0.0"),
        ("watch --scenario absent --tum nowhere", "scenario must be one of"),
    ],
)
def test_bad_argument_is_named(line: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line.split()) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "change"),
    [
        (compare.Args, {"episodes": 0}),
        (compare.Args, {"jobs": 0}),
        (compare.Args, {"seed": -1}),
        (compare.Args, {"policies": ()}),
        (consistency.Args, {"episodes": 0}),
    ],
)
def test_bad_number_is_named(args: Any, change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        args(**change)


def test_a_bad_number_on_the_command_line_ends_it() -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["study", "--episodes", "0"])
    assert exit_.value.code == 2
