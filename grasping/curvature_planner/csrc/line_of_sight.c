/* line_of_sight.py: the depth image of an object, drawn again from its cloud, and what it hides. */
#include "planner.h"

#include <math.h>
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

/* Where a point is in an image at depth 1, and its depth. */
typedef struct {
    double x, y, z;
} Place;

static Place seen_from(Points points, ptrdiff_t i, const double turn[9], const double eye[3])
{
    const double x = points.x[i] - eye[0], y = points.y[i] - eye[1], z = points.height[i] - eye[2];
    Place place = {(turn[0] * x + turn[1] * y) + turn[2] * z, (turn[3] * x + turn[4] * y) + turn[5] * z,
                   (turn[6] * x + turn[7] * y) + turn[8] * z};
    place.x /= place.z;
    place.y /= place.z;
    return place;
}

/* Index of the pixel of a place in the image, −1 outside of it. */
static ptrdiff_t pixel_of(double x, double y, const double edges[3])
{
    const double column = (x - edges[0]) * edges[2], row = (y - edges[1]) * edges[2];
    if (!(column >= 0.0 && column < SIGHT_PIXELS && row >= 0.0 && row < SIGHT_PIXELS))
        return -1;
    return (ptrdiff_t)row * SIGHT_PIXELS + (ptrdiff_t)column;
}

static void draw(Points points, const double turn[9], const double eye[3], const double edges[3], double *depth)
{
    for (ptrdiff_t i = 0; i < points.count; i++) {
        const Place place = seen_from(points, i, turn, eye);
        const ptrdiff_t pixel = place.z > NEAREST ? pixel_of(place.x, place.y, edges) : -1;
        if (pixel >= 0)
            depth[pixel] = least(depth[pixel], place.z);
    }
}

static void clear(double *depth)
{
    for (ptrdiff_t i = 0; i < SIGHT_PIXELS * SIGHT_PIXELS; i++)
        depth[i] = INFINITY;
}

/* Close single pixels without a surface between two with one. before: the last row as it was, and the one that is. */
static void close_gaps(double *depth)
{
    double before[SIGHT_PIXELS], own[SIGHT_PIXELS];
    for (ptrdiff_t column = 0; column < SIGHT_PIXELS; column++)
        before[column] = INFINITY;
    for (ptrdiff_t row = 0; row < SIGHT_PIXELS; row++) {
        double *line = depth + row * SIGHT_PIXELS;
        memcpy(own, line, sizeof(own));
        for (ptrdiff_t column = 0; column < SIGHT_PIXELS; column++) {
            if (own[column] < INFINITY)
                continue;
            double across = INFINITY, down = INFINITY;
            if (column > 0 && column + 1 < SIGHT_PIXELS)
                across = greatest(own[column - 1], own[column + 1]);
            if (row > 0 && row + 1 < SIGHT_PIXELS)
                down = greatest(before[column], line[SIGHT_PIXELS + column]);
            line[column] = across < INFINITY ? across : down;
        }
        memcpy(before, own, sizeof(own));
    }
}

/* Whether taken pixels have enough others within two pixels to the right and below to be a surface. */
static int hangs_together(const double *depth)
{
    ptrdiff_t taken = 0, neighbours = 0;
    for (ptrdiff_t row = 0; row + 2 < SIGHT_PIXELS; row++) { /* around the object there is room */
        const double *line = depth + row * SIGHT_PIXELS, *below = line + SIGHT_PIXELS, *farther = below + SIGHT_PIXELS;
        for (ptrdiff_t i = 0; i + 2 < SIGHT_PIXELS; i++) {
            if (!(line[i] < INFINITY))
                continue;
            taken++;
            neighbours += line[i + 1] < INFINITY || line[i + 2] < INFINITY;
            neighbours += below[i] < INFINITY || farther[i] < INFINITY;
        }
    }
    return 5 * neighbours >= TOGETHER * taken;
}

double look_from(Points cloud, Points others, Points unseen, const double eye[3], double lens[LENS], double *depth)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double *rows[3] = {cloud.x, cloud.y, cloud.height};
    for (int axis = 0; axis < 3; axis++)
        for (ptrdiff_t i = 0; i < cloud.count; i++) {
            low[axis] = least(low[axis], rows[axis][i]);
            high[axis] = greatest(high[axis], rows[axis][i]);
        }
    double forward[3], turn[9];
    for (int axis = 0; axis < 3; axis++)
        forward[axis] = 0.5 * (low[axis] + high[axis]) - eye[axis];
    towards(forward, turn);
    double left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY, nearest = INFINITY;
    ptrdiff_t ahead = 0;
    for (ptrdiff_t i = 0; i < cloud.count; i++) {
        const Place place = seen_from(cloud, i, turn, eye);
        if (!(place.z > NEAREST))
            continue;
        ahead++;
        nearest = least(nearest, place.z);
        left = least(left, place.x);
        right = greatest(right, place.x);
        top = least(top, place.y);
        bottom = greatest(bottom, place.y);
    }
    clear(depth);
    memset(lens, 0, LENS * sizeof(double));
    if (!ahead)
        return 0.0;
    double size = (greatest(right - left, bottom - top) + 2.0 * AROUND / greatest(nearest, 0.05)) / SIGHT_PIXELS;
    double edges[3];
    for (int coarser = 0; coarser <= COARSER; coarser++) {
        edges[0] = 0.5 * (left + right) - 0.5 * SIGHT_PIXELS * size;
        edges[1] = 0.5 * (top + bottom) - 0.5 * SIGHT_PIXELS * size;
        edges[2] = 1.0 / size;
        if (coarser)
            clear(depth);
        draw(cloud, turn, eye, edges, depth);
        if (hangs_together(depth))
            break;
        size *= 2.0;
    }
    ptrdiff_t behind = 0;
    for (ptrdiff_t i = 0; i < cloud.count; i++) {
        const Place place = seen_from(cloud, i, turn, eye);
        const ptrdiff_t pixel = place.z > NEAREST ? pixel_of(place.x, place.y, edges) : -1;
        behind += pixel >= 0 && place.z > depth[pixel] + BEHIND_ITSELF;
    }
    draw(others, turn, eye, edges, depth);
    close_gaps(depth);
    for (ptrdiff_t i = 0; i < unseen.count; i++) {
        const Place place = seen_from(unseen, i, turn, eye);
        const ptrdiff_t pixel = place.z > NEAREST ? pixel_of(place.x, place.y, edges) : -1;
        if (pixel >= 0 && depth[pixel] == INFINITY)
            depth[pixel] = least(HOLE_REACHES - nearest, -NEAREST);
    }
    memcpy(lens, turn, sizeof(turn));
    for (int row = 0; row < 3; row++)
        lens[9 + row] = -((turn[3 * row] * eye[0] + turn[3 * row + 1] * eye[1]) + turn[3 * row + 2] * eye[2]);
    memcpy(lens + 12, edges, sizeof(edges));
    return (double)behind / (double)ahead;
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
