/* See boosted_trees.BoostedTrees.log_odds: what the trees say of a few rows at a time, one tree after the other.
 *
 * A tree of up to 32 leaves is not descended: all its nodes are asked, and each that leads to the right strikes the
 * leaves on its left out. Of what is left the first is the leaf (Lucchese et al., QuickScorer, SIGIR 2015). No row waits
 * for what another node said, so that rows are dealt with side by side. */
#include "segmentation.h"

#include <stdlib.h>

enum { ROWS = 32, MOST_LEAVES = 32 };

/* What a step down a larger tree needs, in one place. A leaf leads to itself: every row takes as many steps as the deepest
 * one needs, so that no processor has to guess when to stop. */
typedef struct {
    float threshold;
    uint32_t asked; /* the feature, and in the last bit the answer where that is not known */
    int32_t next[2]; /* where the answer is no, and yes */
} Node;

/* keep: the leaves that are left where the answer is no. */
typedef struct {
    float threshold;
    uint32_t asked, keep;
} Question;

/* Questions of a tree; 0 for one with too many leaves, and for one that is a leaf. value: at `place_of` each leaf's bit. */
typedef struct {
    ptrdiff_t count;
    Question questions[MOST_LEAVES - 1];
    double value[MOST_LEAVES];
} Tree;

struct PackedTrees {
    ptrdiff_t count, columns; /* how many features a row must have */
    Tree *trees;
    double *value;
    Node *nodes;
    int32_t *start, *depth; /* of each tree its root, and steps from there to the farthest leaf */
};

/* Another number below 32 for each power of two, by de Bruijn's sequence. */
static inline uint32_t place_of(uint32_t bit) { return (uint32_t)(bit * UINT32_C(0x077CB531)) >> 27; }

static inline uint32_t lowest(uint32_t bits) { return bits & (~bits + 1u); }

/* Depth first, yes before no. Returns the leaves under a node, as bits; `leaves` is how many there are so far. */
static uint32_t ask_all(const PackedTrees *packed, int32_t at, Tree *tree, int *leaves)
{
    const Node *node = &packed->nodes[at];
    if (*leaves >= MOST_LEAVES) {
        *leaves = MOST_LEAVES + 1;
        return 0;
    }
    if (node->next[0] == at) {
        const uint32_t bit = UINT32_C(1) << (*leaves)++;
        tree->value[place_of(bit)] = packed->value[at];
        return bit;
    }
    const uint32_t yes = ask_all(packed, node->next[1], tree, leaves), no = ask_all(packed, node->next[0], tree, leaves);
    if (*leaves <= MOST_LEAVES)
        tree->questions[tree->count++] = (Question){node->threshold, node->asked, ~yes};
    return yes | no;
}

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
    for (ptrdiff_t k = 0; k < trees->trees; k++) {
        const int32_t start = packed->start[k] = trees->start[k];
        if (start < 0 || start >= trees->nodes)
            return OUT_OF_RANGE;
        packed->depth[k] = depth[start];
        Tree *tree = &packed->trees[k];
        int leaves = 0;
        tree->count = 0;
        if (depth[start] < MOST_LEAVES)
            ask_all(packed, start, tree, &leaves);
        if (leaves > MOST_LEAVES)
            tree->count = 0;
    }
    return 0;
}

int pack_trees(const Trees *trees, PackedTrees **answer)
{
    const size_t each = sizeof(double) + sizeof(Node) + sizeof(int32_t), of_tree = sizeof(Tree) + 2 * sizeof(int32_t);
    PackedTrees *packed = malloc(sizeof(*packed) + (size_t)trees->nodes * each + (size_t)trees->trees * of_tree);
    if (!packed)
        return OUT_OF_MEMORY;
    packed->count = trees->trees;
    packed->columns = 1; /* a leaf, too, reads the first */
    packed->trees = (Tree *)(packed + 1);
    packed->value = (double *)(packed->trees + trees->trees);
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

/* Add a tree's part to the log odds of so many rows. known: theirs, feature after feature. */
static void ask(const Tree *tree, const float *known, ptrdiff_t rows, double *odds)
{
    uint32_t left[ROWS];
    for (ptrdiff_t row = 0; row < rows; row++)
        left[row] = UINT32_MAX;
    for (ptrdiff_t k = 0; k < tree->count; k++) {
        const Question question = tree->questions[k];
        const float *value = known + rows * (ptrdiff_t)(question.asked >> 1);
        const int32_t unknown = -(int32_t)(question.asked & 1);
        for (ptrdiff_t row = 0; row < rows; row++) {
            const int32_t yes = -(value[row] <= question.threshold) | (-(value[row] != value[row]) & unknown);
            left[row] &= (uint32_t)yes | question.keep;
        }
    }
    for (ptrdiff_t row = 0; row < rows; row++)
        odds[row] += tree->value[place_of(lowest(left[row]))];
}

/* The same of a tree that has too many leaves. */
static void descend(const PackedTrees *packed, ptrdiff_t tree, const float *known, ptrdiff_t rows, double *odds)
{
    int32_t leaves[ROWS];
    for (ptrdiff_t row = 0; row < rows; row++)
        leaves[row] = packed->start[tree];
    for (int32_t step = 0; step < packed->depth[tree]; step++)
        for (ptrdiff_t row = 0; row < rows; row++) {
            const Node *node = &packed->nodes[leaves[row]];
            const float value = known[rows * (ptrdiff_t)(node->asked >> 1) + row];
            leaves[row] = node->next[(value <= node->threshold) | ((value != value) & node->asked)];
        }
    for (ptrdiff_t row = 0; row < rows; row++)
        odds[row] += packed->value[leaves[row]];
}

int add_trees(const PackedTrees *packed, const float *features, ptrdiff_t rows, ptrdiff_t columns, double *odds)
{
    if (columns < packed->columns)
        return OUT_OF_RANGE;
    float *known = malloc((size_t)(ROWS * columns) * sizeof(*known));
    if (!known)
        return OUT_OF_MEMORY;
    for (ptrdiff_t row = 0; row < rows; row += ROWS) {
        const ptrdiff_t some = rows - row < ROWS ? rows - row : ROWS;
        for (ptrdiff_t k = 0; k < some; k++)
            for (ptrdiff_t column = 0; column < columns; column++)
                known[some * column + k] = features[(row + k) * columns + column];
        for (ptrdiff_t tree = 0; tree < packed->count; tree++)
            if (packed->trees[tree].count)
                ask(&packed->trees[tree], known, some, odds + row);
            else
                descend(packed, tree, known, some, odds + row);
    }
    free(known);
    return 0;
}
