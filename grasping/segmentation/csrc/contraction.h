/* A graph whose edges are contracted one after the other, the one of the lowest priority first: patches that merge, and
 * patches that are grouped into objects. What leads from two nodes to a third is added up. */
#ifndef GRASPING_CONTRACTION_H
#define GRASPING_CONTRACTION_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    double total;
    int64_t pixels; /* −1 when the edge is gone */
} Edge;

/* Edge e has two ends, 2 e and 2 e + 1; each is in the list of one node and leads to the other's. */
typedef struct {
    ptrdiff_t to, next; /* next: of the list, −1 at its end */
} End;

typedef struct {
    double priority;
    ptrdiff_t first, second, edge;
} Entry;

typedef struct {
    ptrdiff_t nodes, edge_count, entry_count, entry_room;
    Edge *edges;
    End *ends;
    ptrdiff_t *head; /* of each node's list of ends */
    ptrdiff_t *beside; /* while one node absorbs another: its edge to each third one, −1 for none */
    ptrdiff_t *parent; /* the lower node that has absorbed each one, or itself */
    Entry *entries; /* a heap */
} Graph;

/* The lower, the sooner an edge is contracted; NAN where it is not at all. */
typedef double (*Priority)(const Edge *edge);

/* Room for so many nodes and edges. close_graph is due also where this fails. */
int open_graph(Graph *graph, ptrdiff_t nodes, ptrdiff_t edges);
void close_graph(Graph *graph);
/* Between two nodes that no edge connects yet. */
void add_edge(Graph *graph, ptrdiff_t one, ptrdiff_t other, double total, int64_t pixels);
/* Fills `parent`. */
int contract(Graph *graph, Priority priority);

#endif
