// Shades eyeballs: iris and pupil from the place on the ball, the lids' shadow and the tears from where the lids are.
// In: as face.frag, and the place on the ball. Out: sRGB.

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_surface;
in vec2 v_uv;

uniform vec3 u_eye_position;  // camera in world space, mm
uniform vec2 u_iris;  // radius of iris and pupil, as a share of the eyeball's
uniform vec3 u_iris_albedo;  // linear RGB near the pupil
uniform vec4 u_lids;  // height of the lids' margins, as shares of the eyeball's radius: upper, lower; left eye, right eye
uniform mat4 u_bones[5];  // as in face.vert: 2 and 3 turn the eyes, 4 the head

out vec4 o_colour;

const vec3 SCLERA = vec3(0.76, 0.72, 0.69);  // white would look lit from inside
const vec3 VEINS = vec3(0.95, 0.80, 0.75);
const float CORNEA = 1.75;  // curvature of the cornea to that of the ball
const float CORNERS = 0.965;  // the eye's corners lie so far aside, as a share of the ball's radius
const vec2 CORNER_HEIGHT = vec2(-0.13, 0.11);  // their height, and its slope outwards

// soft: half of the width of an edge, at least a third of a pixel, or edges would flicker as the eye moves.
vec3 iris_colour(vec2 at, float radius, float soft) {
    float share = radius / u_iris.x;
    float around = atan(at.y, at.x);
    float fibres = 0.5 + 0.5 * sin(around * 37.0 + 3.0 * sin(around * 11.0)) * sin(around * 23.0 + share * 9.0);
    vec3 colour = u_iris_albedo * mix(1.0, 0.26, smoothstep(0.35, 0.95, share)) * (0.72 + 0.56 * fibres);
    colour *= 1.0 + 1.05 * smoothstep(0.3, -0.8, at.y / u_iris.x);  // light gathers opposite the key
    colour *= 1.0 - 0.9 * smoothstep(0.70, 0.98, share);  // limbus
    return mix(vec3(0.003), colour, smoothstep(u_iris.y - soft, u_iris.y + soft, radius));
}

void main() {
    vec3 normal = normalize(v_normal);
    vec3 view = normalize(u_eye_position - v_position);
    vec2 at = (v_uv - 0.5) * 2.0;
    float radius = length(at);
    float soft = max(0.35 * fwidth(radius), 0.02);
    vec3 white = v_albedo * SCLERA * mix(vec3(1.0), VEINS, smoothstep(0.35, 0.95, abs(at.x)));
    vec3 albedo = mix(iris_colour(at, radius, soft), white, smoothstep(u_iris.x - 0.025 - soft, u_iris.x + 0.015 + soft, radius));

    // The lids belong to the head, not to the ball: how far below the upper and above the lower one is this place?
    mat3 head = mat3(u_bones[4]);
    vec3 place = transpose(head) * normal;
    bool is_left = dot(head[0], v_position - u_bones[4][3].xyz) > 0.0;
    float outwards = is_left ? place.x : -place.x;
    vec2 margins = is_left ? u_lids.xy : u_lids.zw;
    float aside = min(abs(outwards) / CORNERS, 1.0);
    float arch = 1.0 - pow(aside, 2.2 + 6.0 * max(margins.x - 0.5, 0.0));  // a wide eye is rounder
    vec2 lids = mix(vec2(CORNER_HEIGHT.x + CORNER_HEIGHT.y * outwards), margins, arch);
    float below_upper = lids.x - place.y;
    float above_lower = place.y - lids.y;
    float opening = margins.x - margins.y;
    // The upper lid's shadow is as deep as the eye is open, or half-shut lids would be dark slits.
    float shade = mix(0.10, 0.36, smoothstep(0.1, 0.8, opening));
    float occlusion = mix(0.22, 1.0, smoothstep(-0.05, shade, below_upper));
    occlusion *= mix(0.66, 1.0, smoothstep(-0.03, 0.18, above_lower)) * mix(1.0, 0.7, smoothstep(0.55, 1.0, aside));
    vec3 colour = albedo * irradiance(normal, v_surface.z, occlusion) * mix(0.62, 1.0, occlusion);
    // The upper lashes' line, thicker outside; it hides what is left of an eye that is nearly shut.
    float lashes = mix(0.13, 0.015, smoothstep(0.08, 0.28, opening)) + 0.04 * smoothstep(-0.1, 0.7, outwards);
    colour *= smoothstep(lashes - 0.05, lashes + 0.02, below_upper);

    // The cornea stands out of the ball, so one small highlight of the key lies within the iris.
    vec3 gaze = head * (is_left ? u_bones[2][2].xyz : u_bones[3][2].xyz);
    float on_cornea = 1.0 - smoothstep(0.95 * u_iris.x, 1.3 * u_iris.x, radius);
    vec3 front = normalize(mix(normal, gaze + CORNEA * (normal - gaze), on_cornea));
    float facing = dot(front, view);
    float mirrored = half_way(KEY_FROM, view, dot(front, KEY_FROM) + facing);
    float edge = 0.6 * fwidth(mirrored);
    float catchlight = smoothstep(0.9830 - edge, 0.9930 + edge, mirrored);
    catchlight *= catchlight;  // or its soft edge would be as white as its middle
    catchlight += 0.22 * smoothstep(0.990, 0.997, half_way(FILL_FROM, view, dot(front, FILL_FROM) + facing));
    colour += 1.1 * catchlight * mix(0.08, 1.0, on_cornea) * smoothstep(0.02, 0.10, below_upper) * KEY_COLOUR;
    // Tears stand on the lower lid.
    float tears = smoothstep(0.036, 0.012, above_lower);
    colour += 0.40 * tears * max(dot(normal, KEY_FROM), 0.0);
    o_colour = tone_map(colour);
}
