"""Images and films with a signed claim (C2PA), read back by C2PA's own library; the certificates are made here."""

import datetime
import json
import subprocess
import sys
from pathlib import Path

import c2pa
import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.errors import ResourceError, UsageError
from fapengine.files.moving import write_moving
from fapengine.files.outputs import refuse_foreign
from fapengine.files.pictures import save_png
from fapengine.files.provenance import COMPOSITE, SIGNABLE, SYNTHETIC, provenance, signing

FRAMES = list(np.random.default_rng(1).integers(0, 255, (3, 64, 64, 3), np.uint8))
NOW = datetime.datetime.now(datetime.UTC)


def certificate(
    name: str, public: object, issuer: str, by: object, *, is_authority: bool, until: datetime.datetime
) -> x509.Certificate:
    organization = x509.NameAttribute(NameOID.ORGANIZATION_NAME, "test")
    called = [x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, each), organization]) for each in (name, issuer)]
    uses = [not is_authority, *[False] * 4, is_authority, is_authority, False, False]
    build = (
        x509.CertificateBuilder().subject_name(called[0]).issuer_name(called[1]).public_key(public)  # type: ignore[arg-type]
        .serial_number(x509.random_serial_number())
        .not_valid_before(until - datetime.timedelta(31)).not_valid_after(until)
        .add_extension(x509.BasicConstraints(is_authority, None), critical=True)
        .add_extension(x509.KeyUsage(*uses), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)  # type: ignore[arg-type]
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(by.public_key()), critical=False)  # type: ignore[attr-defined]
    )  # fmt: skip
    if not is_authority:
        build = build.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.EMAIL_PROTECTION]), critical=True)
    return build.sign(by, hashes.SHA256())  # type: ignore[arg-type]


KEYS = {
    "es256": lambda: ec.generate_private_key(ec.SECP256R1()),
    "es384": lambda: ec.generate_private_key(ec.SECP384R1()),
    "ed25519": ed25519.Ed25519PrivateKey.generate,
    "ps256": lambda: rsa.generate_private_key(65537, 2048),
}


def files(
    folder: Path, kind: str = "es256", until: datetime.datetime = NOW + datetime.timedelta(30)
) -> tuple[Path, Path]:
    """Certificates and key, as OpenSSL writes them."""
    authority, own = ec.generate_private_key(ec.SECP256R1()), KEYS[kind]()
    chain = [
        certificate("signer", own.public_key(), "root", authority, is_authority=False, until=until),
        certificate("root", authority.public_key(), "root", authority, is_authority=True, until=until),
    ]
    paths = folder / "chain.pem", folder / "key.pem"
    paths[0].write_bytes(b"".join(each.public_bytes(serialization.Encoding.PEM) for each in chain))
    paths[1].write_bytes(own.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8 if kind == "ed25519" else serialization.PrivateFormat.TraditionalOpenSSL,
        serialization.NoEncryption(),
    ))  # fmt: skip
    return paths


@pytest.fixture(scope="module")
def pem(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return files(tmp_path_factory.mktemp("pem"))


def read(path: Path) -> tuple[str, str, set[str]]:
    """State of the claim, its source, and what does not hold; the test's own authority is nobody that C2PA trusts."""
    with path.open("rb") as file:
        report = json.loads(c2pa.Reader(SIGNABLE[path.suffix], file).json())
    (made,) = [
        each for each in report["manifests"][report["active_manifest"]]["assertions"] if "actions" in each["label"]
    ]
    codes = {each["code"] for each in report.get("validation_status", [])} - {"signingCredential.untrusted"}
    return report["validation_state"], made["data"]["actions"][0]["digitalSourceType"], codes


@pytest.mark.parametrize("suffix", SIGNABLE)
def test_the_claim_says_synthetic_and_a_changed_file_is_detected(
    suffix: str, tmp_path: Path, pem: tuple[Path, Path]
) -> None:
    path = tmp_path / f"a{suffix}"
    source = COMPOSITE if suffix == ".mov" else SYNTHETIC
    with signing(*pem):
        if suffix == ".png":
            save_png(path, FRAMES[0])
        else:
            write_moving(path, FRAMES, rate_hz=10.0, source=source)
    assert read(path) == ("Valid", source, set())
    data = bytearray(path.read_bytes())
    pixels = {".png": b"IDAT", ".webp": b"VP8 ", ".gif": b"\x2c\0\0", ".mp4": b"mdat", ".mov": b"mdat"}[suffix]
    data[data.rindex(pixels) + 40] ^= 1
    path.write_bytes(data)
    state, _, codes = read(path)
    assert state == "Invalid"
    assert codes & {"assertion.dataHash.mismatch", "assertion.bmffHash.mismatch"}


@pytest.mark.parametrize("kind", KEYS)
def test_keys_of_each_kind_sign(kind: str, tmp_path: Path) -> None:
    with signing(*files(tmp_path, kind)):
        save_png(tmp_path / "a.png", FRAMES[0])
    assert read(tmp_path / "a.png")[0] == "Valid"


def test_what_cannot_be_signed_is_refused_before_it_is_made(tmp_path: Path, pem: tuple[Path, Path]) -> None:
    with pytest.raises(UsageError, match=r"got a\.webm, expected a name that ends with \.png"), signing(*pem):
        write_moving(tmp_path / "a.webm", FRAMES, rate_hz=10.0)
    with pytest.raises(UsageError, match="nothing that was written can be signed"), signing(*pem):
        save_png(tmp_path / "chart.png", FRAMES[0], source=None)
    with pytest.raises(UsageError, match="the mark that it signs is left out"), provenance(False), signing(*pem):
        pass
    with pytest.raises(ResourceError, match=r"none\.pem cannot be read"), signing(tmp_path / "none.pem", pem[1]):
        pass
    other = files(tmp_path)[0]
    for wrong in ((pem[1], pem[1]), (pem[0], pem[0]), (other, pem[1])):
        with pytest.raises(UsageError, match="cannot sign"), signing(*wrong):
            pass
    expired = files(tmp_path, until=NOW - datetime.timedelta(1))
    with pytest.raises(UsageError, match=r"cannot sign .*not valid at time of signing"), signing(*expired):
        pass
    assert not list(tmp_path.glob("a*"))


def test_the_command_line_signs(tmp_path: Path, pem: tuple[Path, Path]) -> None:
    (tmp_path / "a.pho").write_text("m 80\na 120\nm 80\n")
    words = ["animate", str(tmp_path / "a.pho"), "-o", str(tmp_path / "a.png"), "--size", "64x64"]
    done = CliRunner().invoke(app, [*words, "--sign", ",".join(map(str, pem))])
    assert done.exit_code == 0, done.output
    assert read(tmp_path / "a.png") == ("Valid", SYNTHETIC, set())
    refused = CliRunner().invoke(app, [*words, "--sign", "chain.pem"])
    assert str(refused.exception) == "--sign: got 'chain.pem', expected two files, CERT,KEY"


def test_a_signed_contact_sheet_is_replaced_by_the_next_run(tmp_path: Path, pem: tuple[Path, Path]) -> None:
    with signing(*pem):
        save_png(tmp_path / "a.png", FRAMES[0])
    refuse_foreign([tmp_path / "a.png"])


def test_a_missing_library_is_told_with_its_extra(pem: tuple[Path, Path]) -> None:
    program = (
        "import sys; sys.modules['c2pa'] = None\nfrom pathlib import Path\n"
        "from fapengine.files.provenance import signing\nfrom fapengine.errors import ResourceError\n"
        f"try:\n    with signing(Path({str(pem[0])!r}), Path({str(pem[1])!r})): pass\n"
        "except ResourceError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert 'pip install "fapengine[sign]"' in done.stdout


def test_the_command_line_refuses_to_sign_what_has_no_place_for_it(tmp_path: Path, pem: tuple[Path, Path]) -> None:
    (tmp_path / "a.pho").write_text("m 80\na 120\nm 80\n")
    words = ["animate", str(tmp_path / "a.pho"), "-o", str(tmp_path / "a.fap"), "--sign", ",".join(map(str, pem))]
    refused = CliRunner().invoke(app, words)
    assert "got a.fap, expected a name that ends with .png" in str(refused.exception)
    assert [path.name for path in tmp_path.iterdir() if path not in pem] == ["a.pho"]
