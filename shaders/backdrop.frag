// What is behind the head: a studio wall, lighter in the middle and darker in the corners, or one colour, or with
// PICTURE a picture. In: place in the picture. Out: sRGB.

in vec2 v_place;

#ifdef PICTURE
uniform sampler2D u_picture;  // sRGB, top row first
#else
uniform vec3 u_wall;  // linear RGB
uniform float u_falloff;  // 1 in a studio, 0 for one colour
#endif

out vec4 o_colour;

void main() {
#ifdef PICTURE
    o_colour = vec4(texture(u_picture, v_place).rgb, 1.0);
#else
    vec2 from_head = (v_place - vec2(0.5, 0.45)) * vec2(1.0, 0.9);
    float light = 1.0 + u_falloff * (0.55 - 2.0 * dot(from_head, from_head));
    o_colour = vec4(sqrt(max(u_wall * light, 0.0)), 1.0);
#endif
}
