// Shows a picture as it is, top row first. In: place in the viewport; the picture, premultiplied by its alpha. Out: sRGB.

in vec2 v_place;

uniform sampler2D u_picture;

out vec4 o_colour;

void main() {
    o_colour = texture(u_picture, vec2(v_place.x, 1.0 - v_place.y));
}
