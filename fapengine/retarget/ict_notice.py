"""Licence notice of ICT-FaceKit, required in copies of its shapes; the built-in heads are derived from them."""

ICT_COPYRIGHT = "shapes derived from ICT-FaceKit, Copyright (c) 2020 USC Institute for Creative Technologies, MIT"
"""Short form, for fields of one line."""
ICT_NOTICE = """\
The form and the shapes of this head are derived from ICT-FaceKit (https://github.com/ICT-VGL/ICT-FaceKit):

MIT License

Copyright (c) 2020 USC Institute for Creative Technologies

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE."""
"""What its licence asks copies to contain; the same as in the file NOTICE."""


def copyright_line(source: str, licence: str) -> str:
    """Source, licence and the notice in one line; the parts of a licence that is one already are not repeated.

    Examples
    --------
    >>> copyright_line("a.glb", "CC_BY; Ada") == f"a.glb; CC_BY; Ada; {ICT_COPYRIGHT}"
    True
    """
    return "; ".join(dict.fromkeys((source, *licence.split("; "), ICT_COPYRIGHT)))
