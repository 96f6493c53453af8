"""Compiles and links shaders in a real OpenGL ES 3 context; a process of its own, so that no other context is touched.

    python gles.py < programs.json

Read: an object of name to [vertex source, fragment source]. Written: an object of name to complaint, for those that do
not link; its key ``""`` holds the driver's GL_VERSION.
"""

import ctypes
import json
import sys

SURFACELESS, ES_API, ES3_BIT, PBUFFER_BIT, NONE = 0x31DD, 0x30A0, 0x40, 0x01, 0x3038
CONTEXT_VERSION, RENDERABLE, SURFACE = 0x3098, 0x3040, 0x3033
VERTEX, FRAGMENT, COMPILED, LINKED, VERSION = 0x8B31, 0x8B30, 0x8B81, 0x8B82, 0x1F02
egl = ctypes.CDLL("libEGL.so.1")


def function(name, result, *arguments):
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    return ctypes.CFUNCTYPE(result, *arguments)(egl.eglGetProcAddress(name.encode()))


def numbers(*values):
    return (ctypes.c_int * len(values))(*values)


def make_current():
    pointer = ctypes.c_void_p
    egl.eglGetPlatformDisplay.restype = egl.eglCreateContext.restype = pointer
    egl.eglGetPlatformDisplay.argtypes = [ctypes.c_int, pointer, pointer]
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    egl.eglChooseConfig.argtypes = [pointer, pointer, pointer, ctypes.c_int, pointer]
    egl.eglCreateContext.argtypes = [pointer] * 4
    egl.eglMakeCurrent.argtypes = [pointer] * 4
    display = egl.eglGetPlatformDisplay(SURFACELESS, None, None)
    assert egl.eglInitialize(display, None, None), "EGL does not start"
    assert egl.eglBindAPI(ES_API)
    config, count = pointer(), ctypes.c_int()
    assert egl.eglChooseConfig(
        display, numbers(RENDERABLE, ES3_BIT, SURFACE, PBUFFER_BIT, NONE), ctypes.byref(config), 1, ctypes.byref(count)
    )
    assert count.value, "no configuration for OpenGL ES 3"
    context = egl.eglCreateContext(display, config, None, numbers(CONTEXT_VERSION, 3, NONE))
    assert context, "no OpenGL ES 3 context"
    assert egl.eglMakeCurrent(display, None, None, context)


def main():
    make_current()
    uint, sint, text = ctypes.c_uint, ctypes.c_int, ctypes.c_char_p
    create_shader, create_program = function("glCreateShader", uint, uint), function("glCreateProgram", uint)
    give_source = function("glShaderSource", None, uint, sint, ctypes.POINTER(text), ctypes.c_void_p)
    compile_shader, link = function("glCompileShader", None, uint), function("glLinkProgram", None, uint)
    attach = function("glAttachShader", None, uint, uint)

    def complaint(kind, of, state):
        ask = function(f"glGet{kind}iv", None, uint, uint, ctypes.POINTER(sint))
        told = function(f"glGet{kind}InfoLog", None, uint, sint, ctypes.c_void_p, ctypes.c_char_p)
        done, log = sint(), ctypes.create_string_buffer(4000)
        ask(of, state, ctypes.byref(done))
        told(of, 4000, None, log)
        return "" if done.value else log.value.decode() or "refused"

    answers = {"": function("glGetString", text, uint)(VERSION).decode()}
    for name, sources in json.load(sys.stdin).items():
        program, said = create_program(), ""
        for kind, source in zip((VERTEX, FRAGMENT), sources, strict=True):
            shader = create_shader(kind)
            give_source(shader, 1, ctypes.byref(text(source.encode())), None)
            compile_shader(shader)
            said = said or complaint("Shader", shader, COMPILED)
            attach(program, shader)
        link(program)
        said = said or complaint("Program", program, LINKED)
        if said:
            answers[name] = said
    json.dump(answers, sys.stdout)


if __name__ == "__main__":
    main()
