"""Many training runs at once: grids, their tables, comparisons of classifiers, robustness."""
