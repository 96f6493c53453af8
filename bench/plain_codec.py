# ruff: noqa: D101, D102, B023
"""The yardstick: the plainest FBA codec in pure Python, lists and linear sums, straight from the description.

Only P planes of low-level FAPs between one I plane and the end, table ranges, q = 1: what the speed figures use.
"""

from fapengine.mpeg4 import fap

QUANTISER = [row.quantiser_step for row in fap.FAPS]
LIMITS = [(row.intra_limit + 59) // 60 * 60 for row in fap.FAPS], [row.predicted_limit for row in fap.FAPS]


class Model:
    def __init__(self, size):
        self.counts = [1] * size
        self.sums = list(range(size, -1, -1))

    def update(self, symbol):
        if self.sums[0] == 16383:
            self.counts = [(count + 1) // 2 for count in self.counts]
            for j in range(len(self.counts) - 1, -1, -1):
                self.sums[j] = self.sums[j + 1] + self.counts[j]
        self.counts[symbol] += 1
        for j in range(symbol + 1):
            self.sums[j] += 1


class PlainEncoder:
    def __init__(self):
        self.bits = []
        self.restart()

    def restart(self):
        self.low, self.high, self.pending, self.zeros = 0, 65535, 0, 0

    def put(self, bit):
        if self.zeros == 22:
            self.bits.append(1)
            self.zeros = 0
        self.bits.append(bit)
        self.zeros = 0 if bit else self.zeros + 1

    def emit(self, bit):
        self.put(bit)
        for _ in range(self.pending):
            self.put(1 - bit)
        self.pending = 0

    def code(self, symbol, sums):
        length = self.high - self.low + 1
        self.high = self.low - 1 + length * sums[symbol] // sums[0]
        self.low = self.low + length * sums[symbol + 1] // sums[0]
        while True:
            if self.high < 32768:
                self.emit(0)
            elif self.low >= 32768:
                self.emit(1)
                self.low -= 32768
                self.high -= 32768
            elif self.low >= 16384 and self.high < 49152:
                self.pending += 1
                self.low -= 16384
                self.high -= 16384
            else:
                return
            self.low *= 2
            self.high = 2 * self.high + 1

    def flush(self):
        self.pending += 1
        self.emit(0 if self.low < 16384 else 1)
        self.restart()


def encode(rows):
    """Code rows of 66 ints; returns the bits behind the I header, and the models' shapes stay the table's."""
    coder = PlainEncoder()
    models = [Model(2 * limit + 1) for limit in LIMITS[1]]
    previous = [0] * 66
    for t, row in enumerate(rows):
        if t:
            coder.bits += [0, 0, 1, 0]
        for i, value in enumerate(row):
            step = QUANTISER[i]
            half = step // 2
            difference = value - previous[i] if t else value
            level = 0 if abs(difference) <= half else (abs(difference) + half) // step
            level = level if difference >= 0 else -level
            limit = LIMITS[1 if t else 0][i]
            level = max(-limit, min(limit, level))
            symbol = level + limit
            previous[i] = level * step + (previous[i] if t else 0)
            if t:
                coder.code(symbol, models[i].sums)
                models[i].update(symbol)
            else:
                coder.code(symbol, list(range(2 * limit + 1, -1, -1)))
        coder.flush()
    return coder.bits


def decode(bits, frames):
    """Undo :func:`encode`; zeros-run stuffing included, look-ahead as the description says."""
    models = [Model(2 * limit + 1) for limit in LIMITS[1]]
    bits = bits + [0] * 64
    previous, out, at = [0] * 66, [], 0
    for t in range(frames):
        if t:
            at += 4
        low, high, zeros, taken = 0, 65535, 0, []
        position = at

        def take():
            nonlocal zeros, position
            if zeros == 22:
                position += bits[position]
                zeros = 0
            bit = bits[position]
            position += 1
            taken.append(position)
            zeros = 0 if bit else zeros + 1
            return bit

        value = 0
        for _ in range(16):
            value = 2 * value + take()
        row = []
        for i in range(66):
            limit = LIMITS[1 if t else 0][i]
            sums = models[i].sums if t else list(range(2 * limit + 1, -1, -1))
            length = high - low + 1
            sought = ((value - low + 1) * sums[0] - 1) // length
            symbol = 0
            while sums[symbol + 1] > sought:
                symbol += 1
            high, low = low - 1 + length * sums[symbol] // sums[0], low + length * sums[symbol + 1] // sums[0]
            while True:
                if high < 32768:
                    shift = 0
                elif low >= 32768:
                    shift = 32768
                elif low >= 16384 and high < 49152:
                    shift = 16384
                else:
                    break
                low, high = 2 * (low - shift), 2 * (high - shift) + 1
                value = 2 * (value - shift) + take()
            if t:
                models[i].update(symbol)
            row.append((symbol - limit) * QUANTISER[i] + (previous[i] if t else 0))
        previous = row
        out.append(row)
        at = taken[-15]
    return out
