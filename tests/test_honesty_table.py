"""`python -m benchmarks.honesty`, small; its whole table is in docs/HONESTY.md."""

from pathlib import Path

import pytest

from benchmarks import honesty


def test_the_command_plays_labels_known_and_unknown_and_no_room_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = ["--policies", "sweep", "--rooms", "3", "--out", str(tmp_path / "honesty.json")]
    monkeypatch.setattr(honesty, "BATCH", 2)
    tables = []
    for _ in range(2):
        honesty.main(line)
        tables.append(capsys.readouterr().out.splitlines()[-4:])
        monkeypatch.setattr(honesty, "play", lambda *_: pytest.fail("played again"))
    assert tables[0] == tables[1]
    assert [row.split(" | ")[0] for row in tables[0][2:]] == ["| `sweep`", "| `sweep`, labels known"]
    assert len({row.count("|") for row in tables[0]}) == 1 and "nan" not in tables[0][2]


def test_wrong_ones_are_a_share_of_all_matches_and_losses_of_all_rooms() -> None:
    one = {"lost": [1, 0, 1, 0], "sure": [1, 0, 0, 0], "score": [-2000.0, 100.0, 300.0, 400.0]}
    one |= {"wrong": [3, 0, 1, 0], "matches": [100, 100, 100, 100], "restarts": [0, 3, 1, 0]}
    one |= {f"{part} {time:g}": [1.0, 3.0] for part in honesty.NEES for time in honesty.TIMES}
    cells = honesty.row_of("x", one).split(" | ")
    assert cells[0] == "| x, 2 begun anew"
    assert cells[1].startswith("50.0 [") and cells[2:6] == ["25.0", "1.0000", "25.0", "25.0"]
    assert cells[6:8] == ["200", "−300"] and "2.00, 2.00, 2.00 · 2.00" in cells[8]
