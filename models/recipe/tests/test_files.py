"""Output files that cannot be written are refused before the work."""

import pytest
from runs import TINY

from nunet_models.cli import main
from nunet_models.errors import ConfigError
from nunet_models.files import check_output_file, check_output_folder


@pytest.fixture
def notes(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("a file, no folder")
    return path


def test_a_file_needs_a_folder_and_may_exist(tmp_path, notes):
    for path in (None, notes, tmp_path / "new.csv"):
        check_output_file("--csv", path)
    with pytest.raises(ConfigError, match=r"`--csv .*` is a folder; expected the name of a file"):
        check_output_file("--csv", tmp_path)
    with pytest.raises(ConfigError, match="absent` is not a folder") as raised:
        check_output_file("--csv", tmp_path / "absent" / "rows.csv")
    assert raised.value.hint == f"mkdir -p {tmp_path / 'absent'}"
    with pytest.raises(ConfigError, match=r"notes\.txt` is not a folder"):
        check_output_file("--csv", notes / "rows.csv")


def test_folders_that_the_command_makes_may_be_missing(tmp_path, notes):
    check_output_file("--out", tmp_path / "a" / "b" / "model.onnx", makes_folders=True)
    check_output_folder("--run", tmp_path / "a" / "b")
    with pytest.raises(ConfigError, match=r"notes\.txt` is not a folder"):
        check_output_file("--out", notes / "a" / "model.onnx", makes_folders=True)
    with pytest.raises(ConfigError, match="is a file; expected a folder"):
        check_output_folder("--run", notes)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"], "nothing is made"


@pytest.mark.parametrize(
    "command",
    [
        ["evaluate", "--model", str(TINY), "--csv", "{}/rows.csv"],
        [
            *("evaluate", "--model", str(TINY)),
            *("--baseline-ids", "train.txt", "--save-baseline", "{}/mean.npy"),
        ],
        ["quantize", "--model", str(TINY), "--out", "{}/int8.onnx"],
        ["export", "--untrained", "unet", "--out", "{}/model.onnx"],
        ["train", "--component", "depth", "--epochs", "1", "--run", "{}/run"],
    ],
)
def test_no_command_starts_its_work(notes, capsys, command):
    """Its data are missing as well, which it would find next."""
    data = ["--data", "absent", "--ids", "absent.txt"]
    if command[0] == "train":
        data = ["--data", "absent", "--cache", "absent", "--train-ids", "a", "--val-ids", "b"]
    if command[0] == "export":
        data = []
    assert main([part.format(notes) for part in command] + data) == 1
    assert f"`{notes}` is not a folder" in capsys.readouterr().err
