/* What the drawing code and the choice between its builds share. */
#ifndef FAPENGINE_FACE_H
#define FAPENGINE_FACE_H
#include <stdint.h>

typedef struct Face Face;

/* The build of face.c for one kind of processor. */
typedef struct {
    const char *name;
    Face *(*open)(const float *vertices, int count, const float *displacements, const float *normal_deltas, int entries,
                  const uint32_t *const *parts, const int *counts);
    void (*close)(Face *face);
    int (*canvas)(Face *face, int width, int height, const uint8_t *background);
    int (*skin)(Face *face, int width, int height, const uint8_t *texels);
    int (*draw)(Face *face, const float *uniforms, int at_vertices, int soft, int format, uint8_t *out);
    void (*resize)(const uint8_t *from, int width, int height, uint8_t *to, int new_width, int new_height);
} Build;

#endif
