"""From files with clouds to grasps: a table, `results.json` and a page to look at."""
