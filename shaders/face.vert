// Moves each vertex by its channels, its bone and the head (theory of operation: fapengine/mesh/face_mesh.py).
// In: rest position in head space, mm. Out: clip space; world position (mm) and normal for shading, or with
// LIT_AT_VERTICES the light itself.

in vec3 a_position;
in vec3 a_normal;
in vec3 a_albedo;
in vec3 a_surface;  // specular strength, gloss, softness of the terminator
in vec2 a_uv;
in float a_occlusion;
in float a_fold;  // share of the folds at rest; -1: a lid, on which entries change the occlusion
in vec3 a_bones;  // bone number, its weight, weight of the head
in vec2 a_entries;  // first entry in the textures, how many

uniform sampler2D u_displacements;  // per entry: displacement in mm per FAPU, channel number
uniform sampler2D u_normal_deltas;  // per entry: change of the normal per FAPU, and of the folds or the occlusion
uniform vec4 u_channels[32];  // channel weights, FAPU, four to a vector
uniform mat4 u_bones[5];  // moved_from_rest: none, jaw, left eye, right eye, head
uniform mat4 u_clip_from_world;

#ifdef LIT_AT_VERTICES
uniform vec3 u_eye_position;  // camera in world space, mm
out vec4 v_diffuse;  // linear RGB for the painting to tint; u
out vec4 v_specular;  // linear RGB on top of it; v
#else
out vec3 v_position;
out vec3 v_normal;
out vec3 v_albedo;
out vec3 v_surface;
out vec2 v_uv;
out float v_occlusion;
#endif

#ifdef PAINTED
out float v_fold;
#endif

void main() {
    vec3 position = a_position;
    vec3 normal = a_normal;
    float shade_change = 0.0;
    int first = int(a_entries.x);
    int end = first + int(a_entries.y);
    int width = textureSize(u_displacements, 0).x;
    for (int entry = first; entry < end; ++entry) {
        ivec2 at = ivec2(entry % width, entry / width);
        vec4 move = texelFetch(u_displacements, at, 0);
        int channel = int(move.w);
        float weight = u_channels[channel / 4][channel % 4];
        position += weight * move.xyz;
        vec4 turn = texelFetch(u_normal_deltas, at, 0);
        normal += weight * turn.xyz;
        shade_change += weight * turn.w;
    }
    float occlusion = a_fold < 0.0 ? clamp(a_occlusion + shade_change, 0.0, 1.0) : a_occlusion;
#ifdef PAINTED
    v_fold = a_fold > 0.0 ? clamp(a_fold + shade_change, 0.0, 1.0) : 0.0;
#endif
    mat4 bone = u_bones[int(a_bones.x)];
    position += a_bones.y * ((bone * vec4(position, 1.0)).xyz - position);
    normal += a_bones.y * (mat3(bone) * normal - normal);
    position += a_bones.z * ((u_bones[4] * vec4(position, 1.0)).xyz - position);
    normal += a_bones.z * (mat3(u_bones[4]) * normal - normal);

#ifdef LIT_AT_VERTICES
    Light light = shade(position, normal, u_eye_position, a_albedo, a_surface, occlusion);
    v_diffuse = vec4(light.diffuse, a_uv.x);
    v_specular = vec4(light.specular, a_uv.y);
#else
    v_position = position;
    v_normal = normal;
    v_albedo = a_albedo;
    v_surface = a_surface;
    v_uv = a_uv;
    v_occlusion = occlusion;
#endif
    gl_Position = u_clip_from_world * vec4(position, 1.0);
}
