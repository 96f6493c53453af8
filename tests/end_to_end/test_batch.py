"""The command batch in processes of its own: rows as the single commands make them, a killed client, Dask's workers."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import UsageError
from tests.processes import start

RUN = [sys.executable, "-m", "fapengine"]
COUNT = 24


def fapengine(*words: object, code: int = 0) -> str:
    done = subprocess.run([*RUN, *map(str, words)], capture_output=True, text=True, timeout=300)
    assert done.returncode == code, done.stderr
    return done.stdout


@pytest.fixture
def corpus(tmp_path: Path) -> Path:
    lines = ["id,timings,seed"]
    for number in range(COUNT):
        (tmp_path / f"{number}.pho").write_text(f"_ 50\nb {60 + number}\na 90\n_ 50\n")
        lines.append(f"{number % 4}/{number},{number}.pho,{number}")
    (tmp_path / "corpus.csv").write_text("\n".join(lines) + "\n")
    return tmp_path / "corpus.csv"


def contents(folder: Path, ending: str = "fap") -> dict[str, bytes]:
    whole = [path for path in folder.rglob(f"*.{ending}") if not path.name.startswith(".")]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in whole}


def test_a_text_is_said_as_say_says_it_whatever_was_said_before(tmp_path: Path) -> None:
    (tmp_path / "corpus.csv").write_text("id,text,seed\na,Hello there.,1\nb,My baby brother.,2\nc,Hello there.,1\n")
    fapengine("batch", tmp_path / "corpus.csv", "-o", tmp_path / "out", "--to", "fap", "--workers", 0)
    fapengine("say", "My baby brother.", "--seed", 2, "-o", tmp_path / "b.fap")
    found = contents(tmp_path / "out")
    assert found["b.fap"] == (tmp_path / "b.fap").read_bytes()
    assert found["a.fap"] == found["c.fap"]


def test_streams_are_encode_s_and_a_failed_row_is_exit_code_2(corpus: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.csv"
    (tmp_path / "bad.pho").write_text("_ fifty\n")
    small.write_text("id,timings,seed,quant\ngood,7.pho,7,4\nbad,bad.pho,1,\n")
    told = json.loads(fapengine("batch", small, "-o", tmp_path / "out", "--workers", 0, "--json", code=2))
    assert (told["rows"], told["done"], list(told["failed"])) == (2, 1, ["bad"])
    fapengine("animate", tmp_path / "7.pho", "--seed", 7, "-o", tmp_path / "7.fap")
    fapengine("encode", tmp_path / "7.fap", "--quant", 4, "-o", tmp_path / "7.fba")
    assert contents(tmp_path / "out", "fba") == {"good.fba": (tmp_path / "7.fba").read_bytes()}
    (tmp_path / "bad.pho").write_text("_ 50\na 100\n")
    assert "2 done, 0 failed" in fapengine("batch", tmp_path / "out", "--retry-failed", "--workers", 0)
    (tmp_path / "out" / "good.fba").write_bytes(b"")
    assert "good: the file" in fapengine("batch", tmp_path / "out", "--verify", code=2)


def test_a_folder_is_a_run_or_files_to_name_by_a_pattern(tmp_path: Path) -> None:
    call = ["batch", str(tmp_path), "-o", str(tmp_path / "out")]
    with pytest.raises(UsageError, match=r"is a folder; use '.*/\*' for the files in it"):
        CliRunner().invoke(app, call, catch_exceptions=False)
    (tmp_path / "batch.json").touch()
    with pytest.raises(UsageError, match="is a folder; use --status, --verify or --retry-failed"):
        CliRunner().invoke(app, call, catch_exceptions=False)


def test_a_killed_client_leaves_no_worker_and_is_resumed(corpus: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    client = start([*RUN, "batch", str(corpus), "-o", str(folder), "--to", "fap", "--workers", "2"])
    while not (folder / "journal.jsonl").exists() or not (folder / "journal.jsonl").stat().st_size:
        assert client.poll() is None
        time.sleep(0.02)
    client.kill()
    client.wait()
    done = (folder / "journal.jsonl").read_bytes().count(b"\n")
    before = {name: (folder / name).stat().st_mtime_ns for name in contents(folder)}
    fapengine("batch", corpus, "-o", folder, "--to", "fap", "--workers", 0)
    assert len(contents(folder)) == COUNT
    kept = sum((folder / name).stat().st_mtime_ns == stamp for name, stamp in before.items())
    assert kept >= done  # nothing that had a line was done again
    assert not list(folder.rglob(".*"))
    fapengine("batch", corpus, "-o", tmp_path / "serial", "--to", "fap", "--workers", 0)
    assert contents(folder) == contents(tmp_path / "serial")


ON_DASK = """
import os, signal, sys
from pathlib import Path
from distributed import Client, LocalCluster
from fapengine.batch.corpus import Corpus
from fapengine.batch.run import plan_run, run, through_client
from fapengine.batch.work import Job

if __name__ == "__main__":
    manifest, folder = sys.argv[1], Path(sys.argv[2])
    rows = Corpus(manifest=manifest, kind="fap").rows()
    killed = []
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1")
    with cluster, Client(cluster) as client:
        def kill(_):
            if not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
        plan = plan_run(rows, Job(folder, "fap"))
        done = run(plan, lambda shards, job: through_client(client, shards, job), 2, folder / "journal.jsonl", kill)
    print(len(done), sum(bool(entry.error) for entry in done.values()), len(killed))
"""


@pytest.mark.nightly
def test_dask_s_workers_write_the_same_and_one_may_be_killed(corpus: Path, tmp_path: Path) -> None:
    (tmp_path / "on_dask.py").write_text(ON_DASK)
    command = [sys.executable, str(tmp_path / "on_dask.py"), str(corpus), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == [str(COUNT), "0", "1"], done.stderr[-3000:]
    fapengine("batch", corpus, "-o", tmp_path / "serial", "--to", "fap", "--workers", 0)
    assert contents(tmp_path / "out") == contents(tmp_path / "serial")
