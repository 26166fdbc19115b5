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

/* Two pixels of different patches that adjoin: the higher patch, and how much of an edge is between them. */
typedef struct {
    int32_t other;
    float value;
} Border;

/* Borders by their lower patch: those of patch i are from start[i] to start[i + 1]; each patch's as they are met, along
 * the rows first, then down the columns. */
typedef struct {
    Border *borders;
    ptrdiff_t *start;
} Borders;

/* Count (borders is NULL) or file those between each pixel and the next one in its row, or `down` its column. */
static void file_borders(const float *edge, const int32_t *labels, ptrdiff_t h, ptrdiff_t w, int down, Borders *filed)
{
    const ptrdiff_t rows = down ? h - 1 : h, columns = down ? w : w - 1, step = down ? w : 1;
    for (ptrdiff_t row = 0; row < rows; row++)
        for (ptrdiff_t pixel = row * w; pixel < row * w + columns; pixel++) {
            const int32_t one = labels[pixel], other = labels[pixel + step];
            if (one == other || one == 0 || other == 0)
                continue;
            const int32_t low = one < other ? one : other;
            if (filed->borders) {
                Border *border = &filed->borders[filed->start[low]];
                border->other = one < other ? other : one;
                border->value = minimum(maximum(edge[pixel], edge[pixel + step]), MOST_EDGE);
            }
            filed->start[low]++;
        }
}

/* Count, then file. */
static int find_borders(const float *edge, const int32_t *labels, ptrdiff_t h, ptrdiff_t w, ptrdiff_t count, Borders *filed)
{
    filed->borders = NULL;
    filed->start = calloc((size_t)count + 2, sizeof(ptrdiff_t));
    if (!filed->start)
        return OUT_OF_MEMORY;
    file_borders(edge, labels, h, w, 0, filed);
    file_borders(edge, labels, h, w, 1, filed);
    ptrdiff_t sum = 0;
    for (ptrdiff_t i = 0; i <= count + 1; i++) {
        const ptrdiff_t number = filed->start[i];
        filed->start[i] = sum;
        sum += number;
    }
    filed->borders = malloc((size_t)(sum + 1) * sizeof(Border));
    if (!filed->borders)
        return OUT_OF_MEMORY;
    file_borders(edge, labels, h, w, 0, filed);
    file_borders(edge, labels, h, w, 1, filed);
    for (ptrdiff_t i = count + 1; i > 0; i--) /* each start has moved to the next one's */
        filed->start[i] = filed->start[i - 1];
    filed->start[0] = 0;
    return 0;
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
        labels[pixel] = (int32_t)number[labels[pixel]];
    return left;
}

ptrdiff_t merge_patches(const float *edge, ptrdiff_t h, ptrdiff_t w, int32_t *labels, ptrdiff_t count)
{
    for (ptrdiff_t pixel = 0; pixel < h * w; pixel++)
        if (labels[pixel] < 0 || labels[pixel] > count)
            return OUT_OF_RANGE;
    Borders filed;
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
