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

struct PackedTrees {
    ptrdiff_t trees, columns; /* how many features a row must have */
    double *value;
    Node *nodes;
    int32_t *start, *depth; /* of each tree its root, and steps from there to the farthest leaf */
};

/* depth: of each node, steps to the farthest leaf. Nodes must lead to later ones, so that there is an end. */
static int pack_nodes(const Trees *trees, PackedTrees *packed, int32_t *depth)
{
    for (ptrdiff_t i = trees->nodes - 1; i >= 0; i--) {
        const int32_t feature = trees->feature[i], left = trees->left[i], right = trees->right[i], own = (int32_t)i;
        const Node leaf = {.next = {own, own}};
        const Node inner = {trees->threshold[i], (uint32_t)feature << 1 | (trees->missing_left[i] > 0), {right, left}};
        packed->nodes[i] = feature < 0 ? leaf : inner;
        packed->value[i] = trees->value[i];
        depth[i] = 0;
        if (feature < 0)
            continue;
        if (left <= i || left >= trees->nodes || right <= i || right >= trees->nodes)
            return OUT_OF_RANGE;
        depth[i] = 1 + (depth[left] > depth[right] ? depth[left] : depth[right]);
        if (feature >= packed->columns)
            packed->columns = (ptrdiff_t)feature + 1;
    }
    for (ptrdiff_t tree = 0; tree < trees->trees; tree++) {
        const int32_t start = packed->start[tree] = trees->start[tree];
        if (start < 0 || start >= trees->nodes)
            return OUT_OF_RANGE;
        packed->depth[tree] = depth[start];
    }
    return 0;
}

int pack_trees(const Trees *trees, PackedTrees **answer)
{
    const size_t each = sizeof(double) + sizeof(Node) + sizeof(int32_t), of_tree = 2 * sizeof(int32_t);
    PackedTrees *packed = malloc(sizeof(*packed) + (size_t)trees->nodes * each + (size_t)trees->trees * of_tree);
    if (!packed)
        return OUT_OF_MEMORY;
    packed->trees = trees->trees;
    packed->columns = 1; /* a leaf, too, reads the first */
    packed->value = (double *)(packed + 1);
    packed->nodes = (Node *)(packed->value + trees->nodes);
    packed->start = (int32_t *)(packed->nodes + trees->nodes);
    packed->depth = packed->start + trees->trees;
    const int code = pack_nodes(trees, packed, packed->depth + trees->trees);
    if (code)
        free(packed);
    else
        *answer = packed;
    return code;
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

int add_trees(const PackedTrees *packed, const float *features, ptrdiff_t rows, ptrdiff_t columns, double *odds)
{
    if (columns < packed->columns)
        return OUT_OF_RANGE;
    for (ptrdiff_t row = 0; row < rows; row += LANES) {
        const int lanes = rows - row < LANES ? (int)(rows - row) : LANES;
        const float *known[LANES];
        for (int lane = 0; lane < LANES; lane++)
            known[lane] = features + (lane < lanes ? row + lane : row) * columns;
        for (ptrdiff_t tree = 0; tree < packed->trees; tree++) {
            int32_t leaves[LANES];
            descend(packed->nodes, packed->start[tree], packed->depth[tree], known, leaves);
            for (int lane = 0; lane < lanes; lane++)
                odds[row + lane] += packed->value[leaves[lane]];
        }
    }
    return 0;
}
