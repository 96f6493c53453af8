// A studio wall: lighter behind the head, darker in the corners. In: place in the picture. Out: sRGB.

in vec2 v_place;

uniform vec3 u_wall;  // linear RGB
uniform float u_alpha;

out vec4 o_colour;

void main() {
    vec2 from_head = (v_place - vec2(0.5, 0.45)) * vec2(1.0, 0.9);
    float light = 1.25 - 1.5 * dot(from_head, from_head);
    o_colour = vec4(sqrt(max(u_wall * light, 0.0)), 1.0) * u_alpha;
}
