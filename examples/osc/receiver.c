/* Read one /fap/1/frame of docs/frames-out.md; p is after the session string. A sketch without a library. */
int32_t number = be32(p);        int64_t time_us = be64(p + 4);
const uint8_t *mask = p + 16;    const uint8_t *value = p + 28;   /* 4 bytes length, 9 of mask, 3 of padding */
for (int n = 1; n <= 68; n++)
    if (mask[(n - 1) / 8] & 0x80 >> (n - 1) % 8)
        for (int k = 0; k < (n == 1 ? 4 : n == 2 ? 6 : 1); k++, value += 4)
            set(n, k, be32(value));
