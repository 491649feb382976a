"""Every command with its options, and where its work stands: what help needs, and nothing heavy."""

from __future__ import annotations

from collections.abc import Mapping

from identify.cli.common import Options

SET: Options = {"--set KEY=VALUE+": 'another value in place of the one in the scene: rig.mass="0.3 kg"'}
SAID: Options = {
    "what is printed": {
        "--json": "one JSON document on standard output, words on stderr",
        "--quiet": "no progress and no notes: the answer alone",
        "--verbose": "every stage of the work with its seconds, and costs",
        "--progress {shown,json}": "json: one document a line",
        "--debug": "show the traceback of an error",
    }
}
READING: Options = {
    "how to read the logs": {
        "--step N": "use this step of the run (default: all, on one clock)",
        "--run N": "use this run, where a log has several",
        "--columns NAME=COLUMN,…": "such as time=T,friction_force=Fx,normal_force=Fz",
        "--units NAME=UNIT,…": "such as friction_force=N,time=s",
        "--normal-force FORCE": 'constant, where the log has none: "3 N"',
        "--rate HZ": 'sampling rate, where the log has no clock: "4 Hz"',
        "--arm LENGTH": 'at which a measured torque acts: "25 mm"',
        "--area AREA": 'on which a measured stress acts: "2 cm^2"',
    }
}
PART: Options = {
    "how much of the logs to read": {
        "--window START,STOP": 'from the first row on, such as "100 s,2 min"',
        "--channels NAME,…": "which of the other columns to keep; none keeps none",
    }
}
POINT: Options = {
    "--scene SCENE.toml": "the values of a scene: fixed, else start, else default; or",
    "--result result.json": "the estimates of a fit, with their uncertainty",
    "--at KEY=VALUE*": 'drive_speed="1 mm/s", normal_force, or any parameter; repeatable (default: those of each log)',
    "--advice MARGIN?": "the nearest change of each quantity that makes sliding steady, with a margin (default: 20 %)",
    "--group GROUP+": "of a fit with parameters per group: this one, V08 or volunteer=V08 (default: each)",
    "--without EFFECT+": "leave out an effect of the scene: one with which no cycle is like the one before",
    "--plot FILE": "draw it over drive speed, or the map (png, svg or pdf)",
    "maps": {
        "--map NAME*": "over one or two of drive_speed, stiffness, normal_force, pressure, area, damping, zeta, mass, "
        "t_cr, D, mu_k0, mu_step (μs - μk0), a, or any other parameter",
        "--range NAME=LOW:HIGH+": 'drive_speed="0.1 mm/s:10 mm/s" (default: around the point)',
        "--points N": "along each quantity (default: 60, of one alone 120)",
        "--data FILE": "the numbers of the map (csv)",
    },
}

COMMANDS: Mapping[str, tuple[str, str]] = {  # module and function, and a line of help
    "demo": ("fit.demo", "the main job on example logs: fit, summary, report"),
    "fit": ("fit.fit_logs", "identify the friction parameters from all the logs together, and write a report"),
    "figures": (
        "fit.figures",
        "the figures of a fit for a paper: SVG, PDF and PNG, one and two columns wide, captions",
    ),
    "verify": ("fit.verify", "run a stored fit again from its recorded inputs and compare"),
    "inspect": (
        "logs.inspect",
        "what is in a log: steps, units, sampling, quality, stick and slip, the classical table",
    ),
    "scene": ("logs.scene", "write a first, commented scene file from your logs"),
    "convert": ("logs.convert", "write any readable log in the HDF5 layout of this project"),
    "rig": ("bench.rig", "mass, stiffness and damping of a rig, from taps and slow pulls (docs/measuring.md)"),
    "plan": ("bench.plan", "which few logs to record next, and what they are expected to identify (docs/planning.md)"),
    "batch": ("studies.batch", "one fit per group of a manifest (CSV) or per file of a folder, with a page of all"),
    "compare": (
        "studies.compare_fits",
        "comparison tables and plots over finished fits (fit or batch folders), by a label",
    ),
    "simulate": ("simulation.simulate", "run the model of a scene forward and write a log"),
    "stability": ("operating.answers", "does the pair stick and slip at an operating point, up to which speed"),
    "amplitude": ("operating.answers", "how large, fast and frequent the jumps are at an operating point"),
    "app": ("app.serve", "work in a local web page: see logs, place cuts, try values, fit, map, compare"),
}
OPTIONS: Mapping[str, Options] = {  # as `add_options` takes them
    "demo": {"--out DIR": "folder of the result (default: stickslip-example-pair)"},
    "fit": {
        "logs LOG*": "choose among the scene's logs, or add one to them",
        "--scene SCENE.toml!": "rig, parameters and logs",
        "--out DIR": "folder of the result (default: stickslip-<scene name>)",
        **SET,
        "how finely, and how sure": {
            "--preview": "draw the cycles and the start over the data, and stop",
            "--accuracy X": "coarse, default, tight, or the error of the steps in standard errors",
            "--time-limit T": 'for all of it: "5 min", or 300 [s] (default: [fit] time_limit of the scene, or 60 s)',
            "--profile": "profile likelihood of every parameter",
            "--bootstrap N": "parametric bootstrap with N replicates",
            "--accuracy-table": "what each level of accuracy costs and changes",
            "--starts {data,user,both}": "start from data, from the scene, or both (default: what there is)",
        },
        **READING,
    },
    "figures": {
        "result RESULT": "the folder of a fit, or its result.json",
        "--out DIR": "folder of the figures (default: <folder of the fit>-figures)",
    },
    "verify": {
        "result RESULT.json": "the result.json of an earlier fit",
        "logs LOG*": "where logs of that fit lie now, if they were moved",
    },
    "inspect": {
        "logs LOG+": "one or more logs",
        "--plot FILE": "draw force and phases over time (png, svg or pdf)",
        "--stiffness K": 'of the rig, to compare the sticks with: "1470 N/m"',
        "--drive-speed V": 'where the log has none: "0.1 mm/s"',
        "--mass M": 'moving mass of the rig, for how fast it slips: "0.2 kg"',
        **READING,
        **PART,
    },
    "scene": {
        "logs LOG+": "the logs of one pair",
        "--out SCENE.toml!": "the file to write; never overwritten",
        "--rig RIG.toml": "a file that stickslip rig wrote, which the scene takes",
        **READING,
    },
    "convert": {
        "log LOG": "a log in any readable format",
        "--out LOG.h5!": "the file to write; never overwritten",
        "--anonymise": "leave out names, dates, paths and free text",
        **READING,
        **PART,
    },
    "rig": {
        "logs LOG*": "taps that ring down, pulls or stick-slip on a block",
        "--out RIG.toml!": "the file to write; never overwritten",
        "--drive-speed [LOG=]SPEED+": 'where a log has none: "1 mm/s"',
        "--added-mass LOG=MASS+": 'fixed to the holder: "tap2.csv=50 g"',
        "--skin LOG+": "one more log: a stick on skin, not on the block",
        "--known NAME=VALUE±ERROR+": 'such as mass="180 g ± 2 g"',
        **READING,
    },
    "plan": {
        "source SCENE.toml|result.json": "a scene, or a fit",
        "--budget T": 'for all logs together (default: "15 min")',
        "--for NAME,…": "parameters to be identified (default: all of friction)",
        "--out STEPS.csv": "the step programme as a table, to type into a script",
        **SET,
        "what can be set at the rig; lists with commas": {
            "--speed SPEEDS": '"0.1 mm/s,1 mm/s" (default: dials around that of the scene)',
            "--load FORCES": '"1 N,2 N" (default: that of the scene)',
            "--stiffness SPRINGS": '"500 N/m,1.5 N/mm" (default: that of the scene)',
            "--fastest HZ": 'highest sampling rate there is, "100 Hz" (default: any)',
            "--no-holds": "the drive cannot stand within a log: propose no slide-hold-slide",
        },
    },
    "batch": {
        "source SOURCE": "manifest (CSV: path, group, drive_speed, …), or a folder",
        "--scene SCENE.toml!": "rig and parameters for all groups",
        "--out DIR!": "folder of the batch",
        **SET,
        "--jobs N": "fits at a time (default: one per core)",
        "--scheduler ADDRESS": "run on the Dask cluster there, such as tcp://host:8786",
        "--resume": "go on in DIR: only what is missing or changed is fitted",
        "--time-limit T": "for one fit (default 30 min)",
    },
    "compare": {
        "folders DIR+": "folders of fits or batches",
        "--by LABEL!": "the label whose groups are compared",
        "--out DIR": "folder of the answer (default: stickslip-by-<label>)",
        "--subject LABEL": 'whose fit it is (default: volunteer, subject, participant or person; "none": no one)',
        "--without FIT+": "leave out a fit by name",
    },
    "simulate": {
        "--scene SCENE.toml!": "the scene to simulate: fixed, else start, else default",
        **SET,
        "--duration T!": "how long [s]",
        "--rate HZ!": "samples per second [Hz]",
        "--noise SD": "standard deviation of white force noise [N]",
        "--seed N": "seed of the noise (default 0)",
        "--accuracy X": "relative error of switch times and forces (default: an order below the noise)",
        "--out LOG.csv|LOG.h5!": "the log to write, over a simulated one at most",
    },
    "stability": POINT,
    "amplitude": POINT,
    "app": {
        "folder FOLDER?": "of the logs (default: this one)",
        "--port N": "of 127.0.0.1 (default: a free one)",
        "--no-browser": "print the address, open nothing",
    },
}
