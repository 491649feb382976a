"""Many fits: batches of a manifest or folder, pooling over people and runs, comparison tables and pages.

A batch lives in one folder DIR. Whoever reads it needs only this page; text is UTF-8, numbers are SI, and every file
and every folder of a group appears whole, by one rename, or not at all.

    DIR/batch.json             what was asked and how far it is; written before the first fit and at the end
    DIR/index.csv              one row per group, for people and spreadsheets; rewritten while the batch runs
    DIR/report.html            the page of the batch, once it has ended
    DIR/<folder>/job.json      one group that has ended, whatever its end
    DIR/<folder>/result.json   and report.html, result.h5, classical.csv, parameters.tex, figures/ of a fit;
                               only where a fit was made
    DIR/.*                     the lock, and what is being written; nothing to read

<folder> is the group's name where that is a harmless file name, else made from it: read it, never guess it.

batch.json: {"schema": 1, "kind": "batch", "status": "running" | "done" | "failures" | "stopped", "message": sentence,
    "source": path of the manifest or folder, "scene": path, "set": [KEY=VALUE, …], "numerics": version,
    "started", "finished": UTC or null, "seconds": wall time of the last run, "jobs": N, "scheduler": address or null,
    "columns": [names of the label columns], "counts": {status: n},
    "groups": [{"group": name, "folder": folder, "key": content key, "status": status or "waiting",
                "labels": {name: text}, "logs": [{"path", "sha256", "labels": {name: text}}, …]}, …]}
    Groups stand in the order of the manifest. A group that was never reached is "waiting" and has no folder.

job.json: {"schema": 1, "kind": "job", "group", "folder", "key", "numerics", "status", "message": sentence,
    "labels": {name: text}, "logs": [{"path", "sha256", "labels"}, …], "scene": document of the group's scene,
    "files": {name relative to the folder: bytes}, "result_sha256": of result.json or null, "detail": traceback or null,
    "timing_s": {"fit", "report", "total", "processor"} or {}, "limited": whether the time limit of the batch ended the
    fit, "finished": UTC, "host": name}

status of a group: the status of its fit (converged, solver_failed, wrong_event_count, model_misfit,
    better_start_found, no_cycles, at_bound: result.json is there), or, without result.json: failed (the sentence of
    the error: an unreadable log, say), timed_out, crashed (its process died, or its files could not be reached), defect
    (an error of ours; `detail` has the traceback), outdated (a log or the program changed while the batch ran). A
    resumed batch tries the last four again, and what its time limit ended before it converged.
    labels of a group: a label its logs agree on, else the different texts joined by "; ". labels of a log are exact.

index.csv: group, status, message, result (relative path of result.json, empty without one), folder, logs (number),
    one column per label in the order of the manifest (named "label: x" where the label is called like another column),
    seconds. A text that a spreadsheet would take for a formula has an apostrophe before it, line breaks become spaces;
    exact labels stand in job.json and batch.json. Groups that are waiting have a row too.
"""
