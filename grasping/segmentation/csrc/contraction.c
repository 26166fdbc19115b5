/* See contraction.h. Ties go to the lower pair of nodes, as with Python's heapq of tuples. */
#include "contraction.h"
#include "segmentation.h"

#include <stdlib.h>
#include <string.h>

int open_graph(Graph *graph, ptrdiff_t nodes, ptrdiff_t edges)
{
    memset(graph, 0, sizeof(*graph));
    graph->nodes = nodes;
    graph->entry_room = 2 * edges + 1;
    graph->edges = malloc((size_t)(edges + 1) * sizeof(Edge));
    graph->ends = malloc((size_t)(edges + 1) * 2 * sizeof(End));
    graph->head = malloc((size_t)(nodes + 1) * sizeof(ptrdiff_t));
    graph->beside = malloc((size_t)(nodes + 1) * sizeof(ptrdiff_t));
    graph->parent = malloc((size_t)(nodes + 1) * sizeof(ptrdiff_t));
    graph->entries = malloc((size_t)graph->entry_room * sizeof(Entry));
    if (!graph->edges || !graph->ends || !graph->head || !graph->beside || !graph->parent || !graph->entries)
        return OUT_OF_MEMORY;
    for (ptrdiff_t i = 0; i < nodes; i++) {
        graph->head[i] = graph->beside[i] = -1;
        graph->parent[i] = i;
    }
    return 0;
}

void close_graph(Graph *graph)
{
    free(graph->edges);
    free(graph->ends);
    free(graph->head);
    free(graph->beside);
    free(graph->parent);
    free(graph->entries);
}

static void enlist(Graph *graph, ptrdiff_t node, ptrdiff_t end)
{
    graph->ends[end].next = graph->head[node];
    graph->head[node] = end;
}

void add_edge(Graph *graph, ptrdiff_t one, ptrdiff_t other, double total, int64_t pixels)
{
    const ptrdiff_t edge = graph->edge_count++;
    graph->edges[edge].total = total;
    graph->edges[edge].pixels = pixels;
    graph->ends[2 * edge].to = other;
    graph->ends[2 * edge + 1].to = one;
    enlist(graph, one, 2 * edge);
    enlist(graph, other, 2 * edge + 1);
}

static inline int before(const Entry *a, const Entry *b)
{
    if (a->priority != b->priority)
        return a->priority < b->priority;
    return a->first != b->first ? a->first < b->first : a->second < b->second;
}

static int push(Graph *graph, ptrdiff_t edge, Priority priority)
{
    const ptrdiff_t one = graph->ends[2 * edge].to, other = graph->ends[2 * edge + 1].to;
    const Entry entry = {priority(&graph->edges[edge]), one < other ? one : other, one < other ? other : one, edge};
    if (entry.priority != entry.priority)
        return 0;
    if (graph->entry_count == graph->entry_room) {
        Entry *larger = realloc(graph->entries, (size_t)graph->entry_room * 2 * sizeof(Entry));
        if (!larger)
            return OUT_OF_MEMORY;
        graph->entries = larger;
        graph->entry_room *= 2;
    }
    Entry *entries = graph->entries;
    ptrdiff_t at = graph->entry_count++;
    for (; at > 0 && before(&entry, &entries[(at - 1) / 2]); at = (at - 1) / 2)
        entries[at] = entries[(at - 1) / 2];
    entries[at] = entry;
    return 0;
}

static Entry pop(Graph *graph)
{
    Entry *entries = graph->entries;
    const Entry lowest = entries[0], last = entries[--graph->entry_count];
    ptrdiff_t at = 0, below;
    while ((below = 2 * at + 1) < graph->entry_count) {
        below += below + 1 < graph->entry_count && before(&entries[below + 1], &entries[below]);
        if (!before(&entries[below], &last))
            break;
        entries[at] = entries[below];
        at = below;
    }
    entries[at] = last;
    return lowest;
}

/* Whether an entry still says what its edge is: neither node was absorbed, and nothing was added since. */
static int is_current(const Graph *graph, const Entry *entry, Priority priority)
{
    const Edge *edge = &graph->edges[entry->edge];
    const ptrdiff_t one = graph->ends[2 * entry->edge].to, other = graph->ends[2 * entry->edge + 1].to;
    return edge->pixels >= 0 && (one < other ? one : other) == entry->first &&
           (one < other ? other : one) == entry->second && priority(edge) == entry->priority;
}

/* Note in `beside` what leads away from a node, and take from its list what is gone. */
static void note_edges(Graph *graph, ptrdiff_t node)
{
    ptrdiff_t *link = &graph->head[node];
    while (*link >= 0) {
        End *end = &graph->ends[*link];
        if (graph->edges[*link / 2].pixels < 0) {
            *link = end->next;
        } else {
            graph->beside[end->to] = *link / 2;
            link = &end->next;
        }
    }
}

/* Let the lower node absorb the higher one: what leads from that now leads from this, or adds to what does. */
static int absorb(Graph *graph, ptrdiff_t low, ptrdiff_t high, Priority priority)
{
    int code = 0;
    graph->parent[high] = low;
    note_edges(graph, low);
    for (ptrdiff_t end = graph->head[high], next; end >= 0; end = next) {
        Edge *edge = &graph->edges[end / 2];
        const ptrdiff_t third = graph->ends[end].to, own = graph->beside[third];
        next = graph->ends[end].next;
        if (edge->pixels < 0)
            continue;
        if (third == low) {
            edge->pixels = -1;
        } else if (own >= 0) {
            graph->edges[own].total += edge->total;
            graph->edges[own].pixels += edge->pixels;
            edge->pixels = -1;
            code |= push(graph, own, priority);
        } else {
            graph->ends[end ^ 1].to = low;
            enlist(graph, low, end);
            code |= push(graph, end / 2, priority);
        }
    }
    for (ptrdiff_t end = graph->head[low]; end >= 0; end = graph->ends[end].next)
        graph->beside[graph->ends[end].to] = -1;
    graph->head[high] = -1;
    return code;
}

int contract(Graph *graph, Priority priority)
{
    int code = 0;
    for (ptrdiff_t edge = 0; edge < graph->edge_count; edge++)
        code |= push(graph, edge, priority);
    while (graph->entry_count > 0 && !code) {
        const Entry entry = pop(graph);
        if (is_current(graph, &entry, priority))
            code = absorb(graph, entry.first, entry.second, priority);
    }
    return code;
}
