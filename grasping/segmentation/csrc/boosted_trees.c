/* See boosted_trees.BoostedTrees.log_odds: what the trees say of a few rows at a time, one tree after the other. */
#include "segmentation.h"

#include <stdlib.h>

enum { LANES = 8 }; /* rows that are dealt with side by side: a step waits for memory */

/* What a step down a tree needs, in one place. A leaf leads to itself: every row takes as many steps as the deepest one
 * needs, so that no processor has to guess when to stop. */
typedef struct {
    float threshold;
    uint32_t asked; /* the feature, and in the last bit the answer where that is not known */
    int32_t next[2]; /* where the answer is no, and yes */
} Node;

/* depth: of each node, steps to the farthest leaf. Nodes must lead to later ones, so that there is an end. */
static int pack(const Trees *trees, ptrdiff_t columns, Node *nodes, int32_t *depth)
{
    for (ptrdiff_t i = trees->nodes - 1; i >= 0; i--) {
        const int32_t feature = trees->feature[i], left = trees->left[i], right = trees->right[i], own = (int32_t)i;
        const Node leaf = {.next = {own, own}};
        const Node inner = {trees->threshold[i], (uint32_t)feature << 1 | (trees->missing_left[i] > 0), {right, left}};
        nodes[i] = feature < 0 ? leaf : inner;
        depth[i] = 0;
        if (feature < 0)
            continue;
        if (feature >= columns || left <= i || left >= trees->nodes || right <= i || right >= trees->nodes)
            return OUT_OF_RANGE;
        depth[i] = 1 + (depth[left] > depth[right] ? depth[left] : depth[right]);
    }
    for (ptrdiff_t tree = 0; tree < trees->trees; tree++)
        if (trees->start[tree] < 0 || trees->start[tree] >= trees->nodes)
            return OUT_OF_RANGE;
    return 0;
}

/* The leaves to which LANES rows come, whose features are `known`. */
static void descend(const Node *nodes, int32_t start, int32_t depth, const float *const known[LANES], int32_t leaves[LANES])
{
    for (int lane = 0; lane < LANES; lane++)
        leaves[lane] = start;
    for (int32_t step = 0; step < depth; step++)
        for (int lane = 0; lane < LANES; lane++) {
            const Node *node = &nodes[leaves[lane]];
            const float value = known[lane][node->asked >> 1];
            leaves[lane] = node->next[(value <= node->threshold) | ((value != value) & node->asked)];
        }
}

int add_trees(const Trees *trees, const float *features, ptrdiff_t rows, ptrdiff_t columns, double *odds)
{
    Node *nodes = malloc((size_t)(trees->nodes + 1) * (sizeof(*nodes) + sizeof(int32_t)));
    if (!nodes)
        return OUT_OF_MEMORY;
    int32_t *depth = (int32_t *)(nodes + trees->nodes);
    const int code = pack(trees, columns, nodes, depth);
    for (ptrdiff_t row = 0; row < rows && !code; row += LANES) {
        const int lanes = rows - row < LANES ? (int)(rows - row) : LANES;
        const float *known[LANES];
        for (int lane = 0; lane < LANES; lane++)
            known[lane] = features + (lane < lanes ? row + lane : row) * columns;
        for (ptrdiff_t tree = 0; tree < trees->trees; tree++) {
            const int32_t start = trees->start[tree];
            int32_t leaves[LANES];
            descend(nodes, start, depth[start], known, leaves);
            for (int lane = 0; lane < lanes; lane++)
                odds[row + lane] += trees->value[leaves[lane]];
        }
    }
    free(nodes);
    return code;
}
