"""Many fits of one quantity pooled: random effects of people and runs, small-sample intervals, plain verdicts."""
