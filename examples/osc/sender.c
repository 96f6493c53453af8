/* Send one phone by the reliable protocol of docs/osc.md, and send again what is missing: a sketch without a library.
   Each put writes big-endian and returns the position after it. */
uint8_t packet[1200], *p = packet;
p = put_string(p, "/fap/1/phones");                       /* bytes, a zero, zeros to a multiple of 4 */
p = put_string(p, ",siiiisiiif");                         /* one more siiif for each phone */
p = put_string(p, session);
p = put_int(p, utterance);  p = put_int(p, sequence++);   /* sequence: 0, 1, 2, ... of this utterance's datagrams */
p = put_int(p, index);      p = put_int(p, 1);            /* of the first phone, and how many */
p = put_string(p, "m");
p = put_int(p, start_us);   p = put_int(p, duration_us);
p = put_int(p, 0);          p = put_float(p, 1.0f);
sendto(udp, packet, p - packet, 0, engine, sizeof *engine);

while (receive(packet, &p)) {                             /* p: after address and types */
    if (is(packet, "/fap/1/ack")) {
        p = skip_string(p);                               /* session */
        int32_t of = be32(p), next = be32(p + 4);  uint64_t come = be64(p + 8);
        for (int n = next; n < sent[of]; n++)
            if (n == next || !(come >> (n - next - 1) & 1)) send_again(of, n);
    }
}
