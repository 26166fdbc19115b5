/* See boosted_trees.BoostedTrees.log_odds: one tree after the other for all rows. */
#include "segmentation.h"

#include <math.h>
#include <stdlib.h>

/* What a step down a tree needs, in one place. */
typedef struct {
    float threshold;
    int32_t feature; /* −1 in a leaf */
    int32_t next[2]; /* where the answer is no, and yes */
    int32_t missing; /* the answer where a feature is not known */
} Node;

/* Nodes that lead nowhere but to later ones: whoever follows them comes to an end. */
static int pack(const Trees *trees, ptrdiff_t columns, Node *nodes)
{
    for (ptrdiff_t i = 0; i < trees->nodes; i++) {
        const int32_t feature = trees->feature[i], left = trees->left[i], right = trees->right[i];
        const Node node = {trees->threshold[i], feature < 0 ? -1 : feature, {right, left}, trees->missing_left[i] > 0};
        if (feature >= 0 && (feature >= columns || left <= i || left >= trees->nodes || right <= i || right >= trees->nodes))
            return OUT_OF_RANGE;
        nodes[i] = node;
    }
    for (ptrdiff_t tree = 0; tree < trees->trees; tree++)
        if (trees->start[tree] < 0 || trees->start[tree] >= trees->nodes)
            return OUT_OF_RANGE;
    return 0;
}

int add_trees(const Trees *trees, const float *features, ptrdiff_t rows, ptrdiff_t columns, double *odds)
{
    Node *nodes = malloc((size_t)(trees->nodes + 1) * sizeof(*nodes));
    if (!nodes)
        return OUT_OF_MEMORY;
    const int code = pack(trees, columns, nodes);
    for (ptrdiff_t tree = 0; tree < trees->trees && !code; tree++)
        for (ptrdiff_t row = 0; row < rows; row++) {
            const float *known = features + row * columns;
            int32_t at = trees->start[tree];
            while (nodes[at].feature >= 0) {
                const Node *node = &nodes[at];
                const float value = known[node->feature];
                at = node->next[value != value ? node->missing : value <= node->threshold];
            }
            odds[row] += trees->value[at];
        }
    free(nodes);
    return code;
}
