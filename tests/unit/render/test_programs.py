"""The shaders: names shared with Python, and one source for desktop OpenGL and for OpenGL ES 3 (WebGL 2)."""

import json
import re
import subprocess
import sys
from pathlib import Path

import moderngl
import pytest

from fapengine.render import programs
from fapengine.render.context import Programs, create_context

FACE = ("u_displacements", "u_normal_deltas", "u_channels", "u_bones", "u_clip_from_world", "u_eye_position")
UNIFORMS = {
    "face": FACE,
    "eye": (*FACE, "u_iris", "u_iris_albedo", "u_lids"),
    "wire": ("u_displacements", "u_channels", "u_bones", "u_clip_from_world", "u_ink"),
    "backdrop": ("u_wall", "u_falloff"),
    "edges": ("u_picture",),
    "smooth": ("u_picture",),
    "enlarge": ("u_picture",),
    "planes": ("u_picture",),
}
ALL = [(name, defined) for name in programs.STAGES for defined in programs.VARIANTS.get(name, ((),))]


def expected_uniforms(name: str, defined: tuple[str, ...]) -> set[str]:
    if programs.PICTURE in defined:
        return {"u_picture"}
    return {*UNIFORMS[name], *(("u_skin",) if programs.PAINTED in defined else ())}


def test_shaders_have_the_names_of_the_table() -> None:
    assert len(ALL) == 17
    seen: set[str] = set()
    with create_context() as context:
        compiled = Programs(context)
        for name, defined in ALL:
            program = compiled.get(name, defined)
            uniforms = {key for key in program if isinstance(program[key], moderngl.Uniform)}
            assert uniforms == expected_uniforms(name, defined), (name, defined)
            seen |= {key for key in program if key.startswith("a_")}
        face = compiled.get("face")
        assert face["u_channels"].array_length * 4 == programs.MAX_CHANNELS  # type: ignore[union-attr]
    assert seen == set(programs.FACE_ATTRIBUTES)


def linked_in_es(sources: dict[str, tuple[str, str]]) -> dict[str, str]:
    command = [sys.executable, str(Path(__file__).with_name("gles.py"))]
    done = subprocess.run(command, input=json.dumps(sources), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def es_sources(name: str, defined: tuple[str, ...]) -> tuple[str, str]:
    vertex, fragment = (programs.stage_source(files, programs.ES_HEADER, defined) for files in programs.STAGES[name])
    return vertex, fragment


def test_every_program_links_in_opengl_es_3() -> None:
    """With only the header changed; ES is stricter about types, precision and what must be declared."""
    answers = linked_in_es({" ".join((name, *defined)): es_sources(name, defined) for name, defined in ALL})
    version = answers.pop("")
    assert version.startswith("OpenGL ES 3"), version
    assert answers == {}


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (  # ES does not convert; as Mesa says it, and NVIDIA
            "out vec4 o_colour; void main() { o_colour = vec4(1); float two = 2 * 0.5; }",
            "operand|implicit cast",
        ),
        ("void main() { gl_FragColor = vec4(1.0); }", "gl_FragColor"),
        ("in vec3 v_unknown; out vec4 o_colour; void main() { o_colour = vec4(v_unknown, 1.0); }", "v_unknown"),
    ],
)
def test_the_es_check_refuses(wrong: str, why: str) -> None:
    vertex, _ = es_sources("backdrop", ())
    answers = linked_in_es({"wrong": (vertex, programs.ES_HEADER + wrong)})
    assert re.search(why, answers["wrong"])


def test_definitions_stand_behind_the_header() -> None:
    source = programs.stage_source(("face.frag",), defined=("PAINTED", "CUT_OUT"))
    assert source.startswith("#version 330 core\n#define PAINTED\n#define CUT_OUT\n// Shades")
