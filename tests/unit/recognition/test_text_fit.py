"""Words compared with other words, where nothing tells them apart."""

import numpy as np
import pytest

from fapengine.recognition import small_net
from fapengine.recognition.sphinx_aligner import Aligned
from fapengine.recognition.text_fit import _unlike

WORD = [Aligned(0, "m", 0, 0, 3, "M"), Aligned(0, "ɑ", 0, 3, 9, "AA"), Aligned(0, "p", 0, 9, 12, "P")]


@pytest.mark.parametrize("frames", [2, 12])
def test_a_word_that_fits_no_better_than_others_is_unlike(frames: int) -> None:
    labels = len(small_net.shipped().labels)
    alike = np.full((frames, labels), -2.0, np.float32)
    assert _unlike(WORD, alike) == 1.0
