"""MPEG-4 facial animation: phone timings in, FAP streams and a talking face out.

The folders are floors; imports go down only (``pyproject.toml``, import-linter):

====  ==================================  =====================================================
9     ``cli``                             one file a verb
8     ``live``                            sessions in real time
7     ``render`` ``files`` ``voices``     the edge: pictures, paths, sound
6     ``laboratory``                      recordings -> a profile, with its evidence
5     ``trajectory`` ``profiles``         speech -> motion; the data that make one face speak
4     ``models`` ``speech`` ``retarget``  learned spaces; phones and timings; other rigs
3     ``codec`` ``capture`` ``mesh``      FBA and ``.fap``; recordings; the head
2     ``geometry``                        rotations and splines, without a face word
1     ``mpeg4``                           the standard's tables and ``FapTrack``
====  ==================================  =====================================================

Importing this package imports nothing heavy.
"""

__version__ = "0.1.0"
