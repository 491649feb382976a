"""The page to work in: a local server over one folder of logs; its jobs are the command line, its state the files."""
