/* See surface_patches.merge_patches_reference: the two patches with the smoothest border become one, again and again. */
#include "contraction.h"
#include "segmentation.h"

#include <math.h>
#include <stdlib.h>

#define SMOOTH 0.5
#define MOST_EDGE 2.0f

static double smoothest(const Edge *edge)
{
    const double mean = edge->total / (double)edge->pixels;
    return mean <= SMOOTH ? mean : NAN;
}

/* A pixel with one of another patch beside it: the higher of the two, and how much of an edge is between them. */
typedef struct {
    int32_t other;
    float value;
} Border;

/* Those of patch i, the lower one, are from start[i] to start[i + 1]: along the rows first, then down the columns. */
typedef struct {
    Border *borders;
    ptrdiff_t *start;
} Borders;

/* The pixels that have another patch to the right, and those that have one below. */
typedef struct {
    ptrdiff_t *pixels[2], count[2], step[2];
} Meetings;

static int find_meetings(const int32_t *labels, ptrdiff_t h, ptrdiff_t w, ptrdiff_t patches, Meetings *found)
{
    for (ptrdiff_t row = 0; row < h; row++)
        for (ptrdiff_t pixel = row * w; pixel < (row + 1) * w; pixel++) {
            const int32_t own = labels[pixel];
            if (!own)
                continue;
            if (own < 0 || own > patches)
                return OUT_OF_RANGE;
            for (int down = 0; down < 2; down++) {
                if (down ? row == h - 1 : pixel == row * w + w - 1)
                    continue;
                const int32_t other = labels[pixel + found->step[down]];
                if (other && other != own)
                    found->pixels[down][found->count[down]++] = pixel;
            }
        }
    return 0;
}

static int file_borders(const float *edge, const int32_t *labels, ptrdiff_t patches, const Meetings *found, Borders *filed)
{
    filed->start = calloc((size_t)patches + 3, sizeof(ptrdiff_t));
    filed->borders = malloc((size_t)(found->count[0] + found->count[1] + 1) * sizeof(Border));
    if (!filed->start || !filed->borders)
        return OUT_OF_MEMORY;
    ptrdiff_t *next = filed->start + 1; /* of each patch, where its next border goes: at last, where they end */
    for (int filing = 0; filing < 2; filing++) {
        for (int down = 0; down < 2; down++)
            for (ptrdiff_t i = 0; i < found->count[down]; i++) {
                const ptrdiff_t pixel = found->pixels[down][i], beside = pixel + found->step[down];
                const int32_t own = labels[pixel], other = labels[beside], low = own < other ? own : other;
                if (filing) {
                    Border *border = &filed->borders[next[low]++];
                    border->other = own < other ? other : own;
                    border->value = minimum(maximum(edge[pixel], edge[beside]), MOST_EDGE);
                } else {
                    next[low + 1]++;
                }
            }
        for (ptrdiff_t i = 0; i <= patches && !filing; i++)
            next[i + 1] += next[i];
    }
    return 0;
}

static int find_borders(const float *edge, const int32_t *labels, ptrdiff_t h, ptrdiff_t w, ptrdiff_t patches, Borders *filed)
{
    ptrdiff_t *pixels = malloc((size_t)(2 * h * w) * sizeof(*pixels));
    if (!pixels)
        return OUT_OF_MEMORY;
    Meetings found = {.pixels = {pixels, pixels + h * w}, .step = {1, w}};
    int code = find_meetings(labels, h, w, patches, &found);
    if (!code)
        code = file_borders(edge, labels, patches, &found, filed);
    free(pixels);
    return code;
}

/* An edge for each two patches that adjoin, with the sum over their border. */
static void add_edges(const Borders *filed, ptrdiff_t count, Graph *graph)
{
    for (ptrdiff_t i = 1; i <= count; i++) {
        const ptrdiff_t known = graph->edge_count; /* older edges in `beside` are another patch's */
        for (ptrdiff_t k = filed->start[i]; k < filed->start[i + 1]; k++) {
            const Border *border = &filed->borders[k];
            ptrdiff_t number = graph->beside[border->other];
            if (number < known) {
                number = graph->beside[border->other] = graph->edge_count;
                add_edge(graph, i, border->other, 0.0, 0);
            }
            graph->edges[number].total += border->value;
            graph->edges[number].pixels++;
        }
    }
    for (ptrdiff_t i = 0; i <= count; i++)
        graph->beside[i] = -1;
}

/* Number the patches that are left from 1 up; returns how many there are. `graph` must be contracted. */
static ptrdiff_t renumber(Graph *graph, int32_t *labels, ptrdiff_t pixels)
{
    ptrdiff_t left = 0, *number = graph->beside;
    number[0] = 0;
    for (ptrdiff_t i = 1; i < graph->nodes; i++) /* a parent has the lower number */
        number[i] = graph->parent[i] == i ? ++left : number[graph->parent[i]];
    for (ptrdiff_t pixel = 0; pixel < pixels; pixel++)
        if (labels[pixel])
            labels[pixel] = (int32_t)number[labels[pixel]];
    return left;
}

ptrdiff_t merge_patches(const float *edge, ptrdiff_t h, ptrdiff_t w, int32_t *labels, ptrdiff_t count)
{
    Borders filed = {NULL, NULL};
    ptrdiff_t code = find_borders(edge, labels, h, w, count, &filed);
    if (!code) {
        Graph graph;
        code = open_graph(&graph, count + 1, filed.start[count + 1]);
        if (!code) {
            add_edges(&filed, count, &graph);
            code = contract(&graph, smoothest);
        }
        if (!code)
            code = renumber(&graph, labels, h * w);
        close_graph(&graph);
    }
    free(filed.start);
    free(filed.borders);
    return code;
}
