// Softens the stairs of an edge after drawing: finds its direction from the brightness of four diagonal neighbours and
// averages along it. In: place in the picture; the drawn picture. Out: sRGB.

out vec4 o_colour;

void main() {
    vec2 size = vec2(textureSize(u_picture, 0));
    ivec2 at = ivec2(v_place * size);
    vec4 around = diagonals(at);
    vec2 range = extremes(brightness(texelFetch(u_picture, at, 0)), around);
    float nw = around.x, ne = around.y, sw = around.z, se = around.w;
    vec2 along = vec2(-((nw + ne) - (sw + se)), (nw + sw) - (ne + se));
    float shorter = 1.0 / (min(abs(along.x), abs(along.y)) + max(0.03 * (nw + ne + sw + se), 0.008));
    along = clamp(along * shorter, -6.0, 6.0) / size;
    vec4 narrow = 0.5 * (texture(u_picture, v_place - along / 6.0) + texture(u_picture, v_place + along / 6.0));
    vec4 wide = 0.5 * narrow
        + 0.25 * (texture(u_picture, v_place - along * 0.5) + texture(u_picture, v_place + along * 0.5));
    float wide_brightness = brightness(wide);
    o_colour = wide_brightness < range.x || wide_brightness > range.y ? narrow : wide;
}
