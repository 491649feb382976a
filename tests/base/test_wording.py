"""Text for a terminal of 80 columns."""

from identify.base.wording import WIDTH, columns


def test_a_table_that_does_not_fit_has_narrower_gaps():
    """The first table of the demo was 82 columns wide."""
    row = ["delta_mu_k", "−0.13003", "−0.13014 to −0.12991", "−0.1335 to −0.1265", "s/m", "identified"]
    assert columns([["a", "b"], ["cc", "d"]]) == "  a   b\n  cc  d"
    assert len(columns([row])) <= WIDTH < len("  " + "  ".join(row)) + 1
