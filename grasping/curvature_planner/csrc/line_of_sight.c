/* line_of_sight.py: the depth image of an object, drawn again from its cloud, and what it hides. */
#include "planner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COARSER = 3, TOGETHER = 7 };
static const double AROUND = 0.05, BEHIND = 0.006, BEHIND_ITSELF = 0.02, NEAREST = 1e-3, HOLE_REACHES = 0.03;

/* Rows across a line of sight, and along it. */
static void towards(const double forward[3], double turn[9])
{
    double x = forward[0], y = forward[1], z = forward[2];
    const double length = sqrt(x * x + y * y + z * z);
    if (!(length > 1e-9)) {
        for (int i = 0; i < 9; i++)
            turn[i] = i % 4 == 0;
        return;
    }
    x /= length;
    y /= length;
    z /= length;
    const double ax = fabs(x), ay = fabs(y), az = fabs(z);
    double a, b, c;
    if (ax <= ay && ax <= az) {
        a = 0.0;
        b = -z;
        c = y;
    } else if (ay <= az) {
        a = z;
        b = 0.0;
        c = -x;
    } else {
        a = -y;
        b = x;
        c = 0.0;
    }
    const double size = sqrt(a * a + b * b + c * c);
    a /= size;
    b /= size;
    c /= size;
    const double rows[9] = {a, b, c, y * c - z * b, z * a - x * c, x * b - y * a, x, y, z};
    memcpy(turn, rows, sizeof(rows));
}

/* Where a point is in an image at depth 1, its depth and its pixel. */
typedef struct {
    double x, y, z;
    ptrdiff_t pixel;
} Place;

/* Where a camera looks at points: along the third row of `turn`. */
typedef struct {
    double turn[9], eye[3], edges[3];
} Camera;

/* A place in the camera's frame, not yet divided by its depth. */
static Place in_front(const Camera *camera, double x, double y, double z)
{
    const double *turn = camera->turn;
    x -= camera->eye[0];
    y -= camera->eye[1];
    z -= camera->eye[2];
    return (Place){(turn[0] * x + turn[1] * y) + turn[2] * z, (turn[3] * x + turn[4] * y) + turn[5] * z,
                   (turn[6] * x + turn[7] * y) + turn[8] * z, -1};
}

/* Index of the pixel of a place in the image, −1 outside of it. */
static ptrdiff_t pixel_of(double x, double y, const double edges[3])
{
    const double column = (x - edges[0]) * edges[2], row = (y - edges[1]) * edges[2];
    if (!(column >= 0.0 && column < SIGHT_PIXELS && row >= 0.0 && row < SIGHT_PIXELS))
        return -1;
    return (ptrdiff_t)row * SIGHT_PIXELS + (ptrdiff_t)column;
}

/* The pixels of points (count, 3) among which most may be far outside of the image: those are not even divided. */
typedef struct {
    const Camera *camera;
    double left, right, top, bottom; /* somewhat beyond the image's edges */
} Frame;

static Frame frame_of(const Camera *camera)
{
    const double size = 1.0 / camera->edges[2], left = camera->edges[0], top = camera->edges[1];
    return (Frame){camera, left - size, left + (SIGHT_PIXELS + 1) * size, top - size, top + (SIGHT_PIXELS + 1) * size};
}

static ptrdiff_t pixel_in(const Frame *frame, const double point[3], double *depth)
{
    const Place place = in_front(frame->camera, point[0], point[1], point[2]);
    *depth = place.z;
    if (!(place.z > NEAREST && place.x > frame->left * place.z && place.x < frame->right * place.z &&
          place.y > frame->top * place.z && place.y < frame->bottom * place.z))
        return -1;
    return pixel_of(place.x / place.z, place.y / place.z, frame->camera->edges);
}

/* Whether a surface is in each pixel, with a margin of none around the image. */
enum { STRIDE = SIGHT_PIXELS + 2 };
typedef uint8_t Taken[STRIDE * STRIDE];

static uint8_t *taken_in_row(Taken taken, ptrdiff_t row) { return taken + (row + 1) * STRIDE + 1; }

/* Whether taken pixels have enough others within two pixels to the right and below to be a surface. */
static int hangs_together(Taken taken)
{
    ptrdiff_t all = 0, neighbours = 0;
    for (ptrdiff_t row = 0; row + 2 < SIGHT_PIXELS; row++) { /* around the object there is room */
        const uint8_t *own = taken_in_row(taken, row), *below = own + STRIDE, *farther = below + STRIDE;
        uint8_t number = 0, beside = 0; /* at most twice the pixels of a row */
        for (ptrdiff_t i = 0; i + 2 < SIGHT_PIXELS; i++) {
            number += own[i];
            beside += (own[i] & (own[i + 1] | own[i + 2])) + (own[i] & (below[i] | farther[i]));
        }
        all += number;
        neighbours += beside;
    }
    return 5 * neighbours >= TOGETHER * all;
}

/* Close single pixels without a surface between two with one, across or else down, by the farther one's depth. */
static void close_gaps(Taken taken, double *depth)
{
    for (ptrdiff_t row = 0; row < SIGHT_PIXELS; row++) {
        const uint8_t *own = taken_in_row(taken, row), *above = own - STRIDE, *below = own + STRIDE;
        uint8_t gap[SIGHT_PIXELS], any = 0;
        for (ptrdiff_t i = 0; i < SIGHT_PIXELS; i++) {
            gap[i] = (own[i] ^ 1) & ((own[i - 1] & own[i + 1]) | (above[i] & below[i]));
            any |= gap[i];
        }
        double *line = depth + row * SIGHT_PIXELS;
        for (ptrdiff_t i = 0; any && i < SIGHT_PIXELS; i++)
            if (gap[i])
                line[i] = own[i - 1] & own[i + 1] ? greatest(line[i - 1], line[i + 1])
                                                  : greatest(line[i - SIGHT_PIXELS], line[i + SIGHT_PIXELS]);
    }
}

/* Draw places with pixels as coarse as they are sparse; returns the share of them that others hide. */
static double draw(Place *places, ptrdiff_t count, Camera *camera, const double extent[4], double size, Taken taken,
                   double *depth)
{
    for (int coarser = 0; coarser <= COARSER; coarser++) {
        camera->edges[0] = 0.5 * (extent[0] + extent[1]) - 0.5 * SIGHT_PIXELS * size;
        camera->edges[1] = 0.5 * (extent[2] + extent[3]) - 0.5 * SIGHT_PIXELS * size;
        camera->edges[2] = 1.0 / size;
        memset(taken, 0, sizeof(Taken));
        for (ptrdiff_t i = 0; i < count; i++) {
            const ptrdiff_t pixel = places[i].pixel = pixel_of(places[i].x, places[i].y, camera->edges);
            if (pixel >= 0)
                taken_in_row(taken, pixel / SIGHT_PIXELS)[pixel % SIGHT_PIXELS] = 1;
        }
        if (hangs_together(taken))
            break;
        size *= 2.0;
    }
    for (ptrdiff_t i = 0; i < count; i++)
        if (places[i].pixel >= 0)
            depth[places[i].pixel] = least(depth[places[i].pixel], places[i].z);
    ptrdiff_t behind = 0;
    for (ptrdiff_t i = 0; i < count; i++)
        behind += places[i].pixel >= 0 && places[i].z > depth[places[i].pixel] + BEHIND_ITSELF;
    return (double)behind / (double)count;
}

double look_from(Points cloud, Rows others, Rows unseen, const double eye[3], double lens[LENS], double *depth)
{
    Camera camera = {.eye = {eye[0], eye[1], eye[2]}};
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, forward[3];
    const double *rows[3] = {cloud.x, cloud.y, cloud.height};
    for (int axis = 0; axis < 3; axis++) {
        for (ptrdiff_t i = 0; i < cloud.count; i++) {
            low[axis] = least(low[axis], rows[axis][i]);
            high[axis] = greatest(high[axis], rows[axis][i]);
        }
        forward[axis] = 0.5 * (low[axis] + high[axis]) - eye[axis];
    }
    towards(forward, camera.turn);
    memset(lens, 0, LENS * sizeof(double));
    for (ptrdiff_t i = 0; i < SIGHT_PIXELS * SIGHT_PIXELS; i++)
        depth[i] = INFINITY;
    Place *places = (size_t)cloud.count > SIZE_MAX / sizeof(Place) ? NULL : malloc((size_t)cloud.count * sizeof(Place));
    if (!places)
        return OUT_OF_MEMORY;
    double extent[4] = {INFINITY, -INFINITY, INFINITY, -INFINITY}, nearest = INFINITY;
    ptrdiff_t ahead = 0;
    for (ptrdiff_t i = 0; i < cloud.count; i++) {
        Place place = in_front(&camera, cloud.x[i], cloud.y[i], cloud.height[i]);
        if (!(place.z > NEAREST))
            continue;
        place.x /= place.z;
        place.y /= place.z;
        places[ahead++] = place;
        nearest = least(nearest, place.z);
        extent[0] = least(extent[0], place.x);
        extent[1] = greatest(extent[1], place.x);
        extent[2] = least(extent[2], place.y);
        extent[3] = greatest(extent[3], place.y);
    }
    Taken taken;
    double share = 0.0;
    if (ahead) {
        const double size = greatest(extent[1] - extent[0], extent[3] - extent[2]) + 2.0 * AROUND / greatest(nearest, 0.05);
        share = draw(places, ahead, &camera, extent, size / SIGHT_PIXELS, taken, depth);
    }
    free(places);
    if (!ahead)
        return 0.0;
    const Frame frame = frame_of(&camera);
    for (ptrdiff_t i = 0; i < others.count; i++) {
        double z;
        const ptrdiff_t pixel = pixel_in(&frame, others.at + 3 * i, &z);
        if (pixel < 0)
            continue;
        depth[pixel] = least(depth[pixel], z);
        taken_in_row(taken, pixel / SIGHT_PIXELS)[pixel % SIGHT_PIXELS] = 1;
    }
    close_gaps(taken, depth);
    for (ptrdiff_t i = 0; i < unseen.count; i++) {
        double z;
        const ptrdiff_t pixel = pixel_in(&frame, unseen.at + 3 * i, &z);
        if (pixel >= 0 && depth[pixel] == INFINITY)
            depth[pixel] = least(HOLE_REACHES - nearest, -NEAREST);
    }
    memcpy(lens, camera.turn, sizeof(camera.turn));
    for (int row = 0; row < 3; row++) {
        const double *turn = camera.turn + 3 * row;
        lens[9 + row] = -((turn[0] * eye[0] + turn[1] * eye[1]) + turn[2] * eye[2]);
    }
    memcpy(lens + 12, camera.edges, sizeof(camera.edges));
    return share;
}

int turn_sight(const Sight *sight, const double axes[9], const double origin[3], Sight *turned)
{
    double *lenses = malloc(((size_t)sight->count * LENS + 1) * sizeof(double));
    *turned = (Sight){lenses, sight->depth, sight->count};
    if (!lenses)
        return OUT_OF_MEMORY;
    memcpy(lenses, sight->lenses, (size_t)sight->count * LENS * sizeof(double));
    for (ptrdiff_t eye = 0; eye < sight->count; eye++, lenses += LENS)
        for (int row = 0; row < 3; row++) {
            const double *turn = sight->lenses + eye * LENS + 3 * row;
            for (int k = 0; k < 3; k++)
                lenses[3 * row + k] = (turn[0] * axes[k] + turn[1] * axes[3 + k]) + turn[2] * axes[6 + k];
            lenses[9 + row] += (turn[0] * origin[0] + turn[1] * origin[1]) + turn[2] * origin[2];
        }
    return 0;
}

int doubt(const Sight *sight, double x, double y, double height)
{
    int least_doubt = sight->count > 0 ? 2 : 0;
    for (ptrdiff_t eye = 0; eye < sight->count; eye++) {
        const double *lens = sight->lenses + eye * LENS;
        const double z = ((lens[6] * x + lens[7] * y) + lens[8] * height) + lens[11];
        if (!(z > NEAREST))
            return 0;
        const double nearness = 1.0 / z;
        const double across = (((lens[0] * x + lens[1] * y) + lens[2] * height) + lens[9]) * nearness;
        const double down = (((lens[3] * x + lens[4] * y) + lens[5] * height) + lens[10]) * nearness;
        const ptrdiff_t pixel = pixel_of(across, down, lens + 12);
        if (pixel < 0)
            return 0;
        const double surface = sight->depth[eye * SIGHT_PIXELS * SIGHT_PIXELS + pixel];
        if (!(z > fabs(surface) + BEHIND))
            return 0;
        least_doubt = surface < 0.0 ? 1 : least_doubt;
    }
    return least_doubt;
}
