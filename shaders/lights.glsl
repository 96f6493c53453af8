// The studio's lights, and what every surface does with them; joined in front of face.vert, face.frag and eye.frag.

const vec3 KEY_FROM = vec3(-0.47, 0.53, 0.706);
const vec3 KEY_COLOUR = vec3(1.53, 1.43, 1.35);
const vec3 FILL_FROM = vec3(0.80, 0.10, 0.59);
const vec3 FILL_COLOUR = vec3(0.30, 0.30, 0.30);
const vec3 RIM_FROM = vec3(0.62, 0.40, -0.68);
const vec3 RIM_COLOUR = vec3(1.4, 1.52, 1.75);
const vec3 SKY = vec3(0.36, 0.365, 0.38);
const vec3 GROUND = vec3(0.235, 0.165, 0.135);

// Diffuse light that wraps round the surface: softness 0 is Lambert's.
float wrapped_diffuse(float cosine, float softness) {
    float light = clamp((cosine + softness) / (1.0 + softness), 0.0, 1.0);
    return light * light * (1.0 + softness) * 0.5 + light * (1.0 - softness) * 0.5;
}

// Irradiance of a surface, linear RGB: key with a terminator that reddens with softness, fill, sky and ground.
vec3 irradiance(vec3 normal, float softness, float occlusion) {
    float key = dot(normal, KEY_FROM);
    vec3 terminator = mix(vec3(1.0), vec3(1.25, 0.72, 0.60), softness * smoothstep(0.55, -0.1, key));
    vec3 light = KEY_COLOUR * wrapped_diffuse(key, softness) * terminator;
    light *= mix(0.35, 1.0, smoothstep(0.05, 0.6, occlusion));
    light += FILL_COLOUR * wrapped_diffuse(dot(normal, FILL_FROM), softness) * mix(0.5, 1.0, occlusion);
    light += mix(GROUND, SKY, 0.5 + 0.5 * normal.y) * occlusion;
    return light * mix(vec3(1.06, 0.97, 0.94), vec3(1.0), smoothstep(0.05, 0.65, occlusion));  // light between skin is red
}

// Cosine between a normal and the half vector of light and view, from the cosines of the normal with each.
float half_way(vec3 light, vec3 view, float cosines) {
    return clamp(cosines * inversesqrt(dot(light, light) + 1.0 + 2.0 * dot(light, view)), 0.0, 1.0);
}

// Highlights of key and fill, by Blinn and Phong, normalised; times the surface's specular strength.
vec3 highlight(vec3 normal, vec3 view, float gloss) {
    float facing = dot(normal, view);
    float away = 1.0 - clamp(facing, 0.0, 1.0);
    float fresnel = 0.04 + 0.55 * away * away * away * away * away;
    float key = dot(normal, KEY_FROM);
    float high = pow(half_way(KEY_FROM, view, key + facing), gloss) * clamp(key * 4.0, 0.0, 1.0);
    high += 0.25 * pow(half_way(FILL_FROM, view, dot(normal, FILL_FROM) + facing), gloss);
    // A broad lobe under the narrow one, as of oil on rougher skin.
    float rough = 0.22 * gloss;
    float broad = pow(half_way(KEY_FROM, view, key + facing), rough) * clamp(key * 4.0, 0.0, 1.0);
    return (0.25 + fresnel) * ((gloss + 8.0) * high + 0.6 * (rough + 8.0) * broad) / 25.0 * KEY_COLOUR;
}

struct Light {
    vec3 diffuse;  // linear RGB that the surface's painting tints
    vec3 specular;  // linear RGB on top
};

// Light that a point of the face sends to the eye. Position and eye in mm; the normal need not be of unit length;
// surface is specular strength, gloss, softness of the terminator.
Light shade(vec3 position, vec3 normal, vec3 eye, vec3 albedo, vec3 surface, float occlusion) {
    normal = normalize(normal);
    vec3 view = normalize(eye - position);
    float away = 1.0 - clamp(dot(normal, view), 0.0, 1.0);
    float left = clamp(dot(normal, RIM_FROM) + 0.3, 0.0, 1.0);
    float right = clamp(dot(normal, RIM_FROM * vec3(-1.0, 1.0, 1.0)) + 0.2, 0.0, 1.0);
    float rim = away * away * away * (left + 0.55 * right);
    vec3 rim_light = RIM_COLOUR * rim * (0.10 + 0.5 * surface.x) * occlusion;
    return Light(
        albedo * (irradiance(normal, surface.z, occlusion) + rim_light),
        surface.x * occlusion * highlight(normal, view, surface.y) + 0.15 * rim_light);
}

// Linear RGB to sRGB, with a shoulder that keeps highlights. 2.0 stands in for 2.2: a root costs a tenth of a power.
vec4 tone_map(vec3 colour) {
    colour = colour * (1.0 + colour * 0.12) / (1.0 + colour * 0.42);
    vec3 root = sqrt(max(colour, 0.0));
    return vec4(mix(root, sqrt(root), 0.07), 1.0);
}
