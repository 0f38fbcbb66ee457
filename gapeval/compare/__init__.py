"""Two results, or results and a baseline: what is worse, what is better, which frames and labels changed."""
