"""A file is written whole, or what stood there stays."""

import os
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from fapengine.errors import ResourceError, UsageError
from fapengine.files.motion import load_fap
from fapengine.files.moving import beside, write_moving
from fapengine.files.outputs import check_outputs
from fapengine.files.paths import read_bytes, remove_unfinished, replacing, replacing_folder, write_bytes
from fapengine.files.pictures import load_picture, save_png
from fapengine.files.sound import load_sound
from fapengine.files.video import stream_pictures
from fapengine.server.config import load_config
from tests.processes import start

GOOD = b"an earlier, good file"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "out.bin"
    path.write_bytes(GOOD)
    return path


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file may grow beyond 4 kB, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, SystemExit])
def test_what_stood_there_stays_whatever_ends_the_writing(path: Path, stop: type[BaseException]) -> None:
    with pytest.raises(stop), replacing(path) as new:  # noqa: PT012
        new.write_bytes(b"half")
        raise stop
    assert path.read_bytes() == GOOD
    assert list(path.parent.iterdir()) == [path]


def test_it_is_there_at_once_with_the_mode_of_the_old_one(path: Path) -> None:
    path.chmod(0o640)
    with replacing(path) as new:
        new.write_bytes(b"new")
        assert path.read_bytes() == GOOD
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(path.parent.iterdir()) == [path]


def test_folders_are_made_and_a_new_file_has_the_mode_of_any_new_file(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a" / "b.bin", b"new")
    (tmp_path / "plain").touch()
    assert (tmp_path / "a" / "b.bin").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_links_are_followed_and_devices_written_as_they_are(path: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.bin"
    link.symlink_to(path.name)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert path.read_bytes() == b"new"
    write_bytes(Path("/dev/null"), b"nothing")
    assert Path("/dev/null").is_char_device()


def test_a_folder_in_the_way_is_told(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="cannot be written"):
        write_bytes(tmp_path, b"new")


HEAD = ("head.toml", "head.npz", "takes/*.fap")


def put(folder: Path, *names: str, text: str = "new") -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def held(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("others", [[], ["notes.txt"], ["takes/take.c3d"]])
@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, None])
def test_a_folder_is_replaced_as_one_and_keeps_what_is_not_ours(
    tmp_path: Path, others: list[str], stop: type[BaseException] | None
) -> None:
    folder = tmp_path / "mine"
    put(folder, "head.toml", "head.npz", "takes/1.fap", *others, text="old")
    before = held(tmp_path)
    try:
        with replacing_folder(folder, owned=HEAD) as new:
            put(new, "head.toml", "takes/2.fap")
            assert {name: text for name, text in held(tmp_path).items() if ".part-" not in name} == before
            if stop is not None:
                raise stop
    except (ValueError, KeyboardInterrupt):
        assert held(tmp_path) == before
        return
    assert held(tmp_path) == {
        "mine/head.toml": "new",
        "mine/takes/2.fap": "new",
        **{f"mine/{o}": "old" for o in others},
    }


def test_a_folder_that_a_shell_stands_in_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, "head.npz", text="old")
    monkeypatch.chdir(tmp_path)
    with replacing_folder(Path(), owned=HEAD) as new:
        put(new, "head.toml")
    assert held(Path()) == {"head.toml": "new"}


@pytest.mark.parametrize("name", ["a.mp4", "mine"])
def test_what_a_killed_writer_left_is_removed_by_the_next_and_what_is_being_written_is_not(
    tmp_path: Path, name: str
) -> None:
    import subprocess
    import sys

    function = "replacing(Path('a.mp4'))" if name == "a.mp4" else "replacing_folder(Path('mine'), owned=['*'])"
    imports = "from pathlib import Path; from fapengine.files.paths import *"
    code = f"{imports}\nwith {function}: print('', flush=True); input()"
    with start(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as writer:  # fmt: skip
        writer.stdout.readline()
        (hidden,) = tmp_path.iterdir()
        again(tmp_path / name)
        assert hidden.exists()
        writer.kill()
    assert hidden.exists()
    again(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def again(path: Path) -> None:
    """Write a file, or a folder, by its name."""
    if path.suffix:
        write_bytes(path, b"new")
    else:
        with replacing_folder(path, owned=["*"]) as new:
            put(new, "head.toml")


def test_what_an_exception_between_two_lines_leaves_is_removed_at_the_end(tmp_path: Path) -> None:
    """As a signal does: the block of ``with`` was not entered, and somebody holds the generator."""
    held_by_somebody = replacing(tmp_path / "a.mp4")
    held_by_somebody.__enter__()
    assert len(list(tmp_path.iterdir())) == 1
    remove_unfinished()
    assert not list(tmp_path.iterdir())


def pictures(count: int) -> Iterator[np.ndarray]:
    rng = np.random.default_rng(1)
    return (rng.integers(0, 256, (64, 64, 3), np.uint8) for _ in range(count))


WRITERS: dict[str, Callable[[Path, int], object]] = {
    "out.bin": lambda path, count: write_bytes(path, os.urandom(1000 * count)),
    "out.png": lambda path, count: save_png(path, next(pictures(count))),
    "out.mp4": lambda path, count: write_moving(path, pictures(count), rate_hz=30),
    "out.mkv": lambda path, count: write_moving(path, pictures(count), rate_hz=30),
    "out.webp": lambda path, count: write_moving(path, pictures(count), rate_hz=30),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_leaves_the_good_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(GOOD)
    with pytest.raises(ResourceError, match=f"{name}: cannot be written"):
        WRITERS[name](path, 60)
    assert path.read_bytes() == GOOD
    assert list(tmp_path.iterdir()) == [path]


def test_frames_that_fail_leave_the_good_film(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    path.write_bytes(GOOD)

    def failing() -> Iterator[np.ndarray]:
        yield from pictures(20)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_moving(path, failing(), rate_hz=30)
    assert path.read_bytes() == GOOD
    assert list(tmp_path.iterdir()) == [path]


def test_an_mp4_begins_with_its_list_of_frames_and_holds_sound_beside_its_pictures(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    sound = (np.random.default_rng(1).integers(-9000, 9000, 3 * 22050).astype(np.int16), 22050)
    assert write_moving(path, pictures(90), rate_hz=30, sound=sound) == 90
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    assert chunks_take_turns(path)


def chunks_take_turns(path: Path) -> bool:
    """Whether sound and pictures lie within a second of each other all through the file."""
    import av

    latest = {"audio": 0.0, "video": 0.0}
    with av.open(str(path)) as container:
        for packet in sorted(
            (packet for packet in container.demux() if packet.pts is not None), key=lambda one: one.pos or 0
        ):
            latest[packet.stream.type] = float(packet.pts * packet.time_base)
            if abs(latest["audio"] - latest["video"]) > 1.0:
                return False
    return min(latest.values()) > 2.0


@pytest.mark.parametrize("name", ["/dev/zero", "fifo.npz"])
def test_devices_and_named_pipes_are_not_read(tmp_path: Path, name: str) -> None:
    place = tmp_path / name
    if not place.exists():
        place.parent.mkdir(exist_ok=True)
        os.mkfifo(place)
    for read in (read_bytes, load_sound, load_picture, load_config, load_film):
        with pytest.raises(UsageError, match=r"cannot be read \(a device or a pipe\)"):
            read(place)


def load_film(path: Path) -> None:
    list(stream_pictures(path, max_side=64))


@pytest.mark.parametrize(("name", "most"), [("a.fap", 1 << 30), ("a.toml", 1 << 24), ("a.png", 1 << 28)])
def test_files_beyond_the_limit_of_their_kind_are_not_read(
    tmp_path: Path, name: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(most + 1)
    monkeypatch.setattr(Path, "open", lambda *_: pytest.fail("it was opened"))
    read = {".fap": load_fap, ".toml": load_config, ".png": load_picture}[path.suffix]
    with pytest.raises(UsageError, match=rf"cannot be read \(got {most + 1} bytes or more, expected at most {most}\)"):
        read(path)


def test_a_pipe_that_the_process_was_started_with_is_read_up_to_the_limit(path: Path) -> None:
    for most, outcome in ((9, b"123456789"), (8, None)):
        read, write = os.pipe()
        os.write(write, b"123456789")
        os.close(write)
        try:
            if outcome is None:
                with pytest.raises(UsageError, match="expected at most 8"):
                    read_bytes(Path(f"/dev/fd/{read}"), most)
            else:
                assert read_bytes(Path(f"/dev/fd/{read}"), most) == outcome
        finally:
            os.close(read)


def test_a_link_that_leads_to_itself_is_no_output(tmp_path: Path) -> None:
    (tmp_path / "l.fap").symlink_to("l.fap")
    for path in (tmp_path / "l.fap", tmp_path / "l.fap" / "x.fap"):
        with pytest.raises((UsageError, ResourceError), match=r"leads to itself|cannot be written"):
            write_bytes(path, b"new")
        with pytest.raises(UsageError, match="leads to itself"):
            check_outputs([path])
    with pytest.raises(UsageError, match="cannot be read"):
        read_bytes(tmp_path / "l.fap")


@pytest.mark.parametrize("name", [".", "..", "/"])
def test_a_name_that_is_none_has_nothing_beside_it(name: str) -> None:
    with pytest.raises(UsageError, match="expected a file name"):
        beside(Path(name), ".wav")


def test_outputs_that_differ_only_in_case_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"got .*x\.npz and .*X\.NPZ, which are one file where case does not matter"):
        check_outputs([tmp_path / "x.npz", tmp_path / "X.NPZ"])
    with pytest.raises(UsageError, match="which are one file; expected"):
        check_outputs([tmp_path / "x.npz", tmp_path / "a" / ".." / "x.npz"])
    assert check_outputs([tmp_path / "x.npz", tmp_path / "y.npz"]) == ()


def test_an_input_under_a_name_of_other_case_is_not_written_over(tmp_path: Path) -> None:
    """exFAT of FUSE ignores case and numbers each name: two files that only that makes one."""
    read, written = tmp_path / "Talk.fap", tmp_path / "talk.fap"
    for path in (read, written):
        path.write_bytes(b"the same")
        os.utime(path, ns=(1, 1))
    with pytest.raises(UsageError, match=r"got .*talk\.fap, which is read, and would be written over"):
        check_outputs([written], [read])
    os.utime(written, ns=(1, 2))
    assert check_outputs([written], [read]) == (written,)  # another file after all


@pytest.mark.parametrize(
    "use", [read_bytes, lambda path: write_bytes(path, b"new"), lambda path: check_outputs([path])]
)
def test_a_null_character_is_in_no_name(use: Callable[[Path], object]) -> None:
    with pytest.raises(UsageError, match="without null characters"):
        use(Path("a\0.fap"))


def test_a_new_name_is_no_input_and_a_folder_is_not_searched_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    there = tmp_path / "in" / "there.fap"
    there.write_bytes(b"")
    monkeypatch.setattr(Path, "rglob", lambda *_: pytest.fail("searched"))
    assert check_outputs([tmp_path / "new.fap"], [tmp_path / "in"]) == ()
    monkeypatch.undo()
    with pytest.raises(UsageError, match="which is read"):
        check_outputs([there], [tmp_path / "in"])
