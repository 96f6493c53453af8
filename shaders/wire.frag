// Lines of the wire mesh. Out: sRGB.

uniform vec4 u_ink;  // sRGB, alpha

out vec4 o_colour;

void main() {
    o_colour = u_ink;
}
