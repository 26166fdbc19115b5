/* See correlation_clustering.cluster: greedy additive edge contraction. */
#include "contraction.h"
#include "segmentation.h"

#include <math.h>

static double most_agreement(const Edge *edge) { return edge->total > 0.0 ? -edge->total : NAN; }

int cluster(const int64_t *first, const int64_t *second, const double *agreement, ptrdiff_t pairs, ptrdiff_t nodes,
            int64_t *root)
{
    Graph graph;
    int code = open_graph(&graph, nodes, pairs);
    for (ptrdiff_t i = 0; i < pairs && !code; i++) {
        if (first[i] < 0 || first[i] >= second[i] || second[i] >= nodes)
            code = OUT_OF_RANGE;
        else
            add_edge(&graph, (ptrdiff_t)first[i], (ptrdiff_t)second[i], agreement[i], 0);
    }
    if (!code)
        code = contract(&graph, most_agreement);
    for (ptrdiff_t i = 0; i < nodes && !code; i++) /* a parent has the lower number */
        root[i] = graph.parent[i] == i ? i : root[graph.parent[i]];
    close_graph(&graph);
    return code;
}
