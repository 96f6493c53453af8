// Copies a pixel and marks by its depth whether it lies on an edge (0) or not (1), so that smooth.frag, which is three
// times as dear, runs on edges alone. In: place in the picture; the drawn picture. Out: sRGB, depth.

out vec4 o_colour;

void main() {
    ivec2 at = ivec2(v_place * vec2(textureSize(u_picture, 0)));
    vec4 here = texelFetch(u_picture, at, 0);
    vec2 range = extremes(brightness(here), diagonals(at));
    o_colour = here;
    gl_FragDepth = range.y - range.x < max(0.04, 0.11 * range.y) ? 1.0 : 0.0;
}
