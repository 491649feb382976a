"""Many finished fits side by side: tables of groups, differences with verdicts, the page of a batch."""
