"""Compare what could open our window: time to import and open, and what showing a 512x512 frame costs.

    xvfb-run -a python design/window_toolkits.py        # with moderngl, glfw, pyglet, pygame-ce, moderngl-window

Each toolkit runs in a process of its own and clears and shows 300 frames of an OpenGL 3.3 core context.
"""

import json
import subprocess
import sys
import time

SIZE = (512, 512)
FRAMES = 300


def with_glfw():
    import glfw

    glfw.init()
    for hint, value in (
        (glfw.CONTEXT_VERSION_MAJOR, 3), (glfw.CONTEXT_VERSION_MINOR, 3),
        (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE), (glfw.OPENGL_FORWARD_COMPAT, True),
    ):  # fmt: skip
        glfw.window_hint(hint, value)
    window = glfw.create_window(*SIZE, "glfw", None, None)
    glfw.make_context_current(window)
    glfw.swap_interval(0)

    def show():
        glfw.swap_buffers(window)
        glfw.poll_events()

    return show


def with_pyglet():
    import pyglet

    config = pyglet.gl.Config(double_buffer=True, major_version=3, minor_version=3)
    window = pyglet.window.Window(*SIZE, config=config, vsync=False)

    def show():
        window.flip()
        window.dispatch_events()

    return show


def with_pygame():
    import pygame

    pygame.display.init()
    pygame.display.gl_set_attribute(pygame.GL_CONTEXT_MAJOR_VERSION, 3)
    pygame.display.gl_set_attribute(pygame.GL_CONTEXT_MINOR_VERSION, 3)
    pygame.display.gl_set_attribute(pygame.GL_CONTEXT_PROFILE_MASK, pygame.GL_CONTEXT_PROFILE_CORE)
    pygame.display.set_mode(SIZE, pygame.OPENGL | pygame.DOUBLEBUF)

    def show():
        pygame.display.flip()
        pygame.event.get()

    return show


def with_moderngl_window():
    import moderngl_window

    moderngl_window.settings.WINDOW.update(
        {"class": "moderngl_window.context.pyglet.Window", "size": SIZE, "vsync": False, "gl_version": (3, 3)}
    )
    window = moderngl_window.create_window_from_settings()
    return window.swap_buffers


TOOLKITS = {
    "glfw": with_glfw, "pyglet": with_pyglet, "pygame-ce": with_pygame, "moderngl-window": with_moderngl_window,
}  # fmt: skip


def measure(name: str) -> dict[str, float]:
    import moderngl

    begun = time.perf_counter()
    show = TOOLKITS[name]()
    context = moderngl.get_context() if name == "moderngl-window" else moderngl.create_context(require=330)
    opened = time.perf_counter()
    each = []
    for number in range(FRAMES):
        start = time.perf_counter()
        context.screen.use()
        context.clear(number % 2, 0.3, 0.4)
        show()
        each.append(time.perf_counter() - start)
    each.sort()
    return {"open_ms": 1e3 * (opened - begun), "frame_ms": 1e3 * each[FRAMES // 2], "p99_ms": 1e3 * each[-3]}


def main() -> None:
    for name in TOOLKITS:
        best = None
        for _ in range(3):
            done = subprocess.run([sys.executable, __file__, name], capture_output=True, text=True, check=False)
            if done.returncode:
                print(f"{name:16} {done.stderr.strip().splitlines()[-1]}")
                break
            found = json.loads(done.stdout.splitlines()[-1])
            best = found if best is None or found["frame_ms"] < best["frame_ms"] else best
        if best:
            print(f"{name:16} " + "  ".join(f"{key} {value:.2f}" for key, value in best.items()))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(sys.argv[1])))
    else:
        main()
