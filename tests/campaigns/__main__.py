"""`python -m campaigns [NAME …]`: run them in full, and print a table of counts."""

import argparse
import sys

from rich.console import Console
from rich.table import Table

from campaigns.campaign import campaigns, play_all
from iout_marl.machine import num_cores


def main() -> int:
    """Exit status 1 where there was a fault."""
    known = {campaign.name: campaign for campaign in campaigns()}
    parser = argparse.ArgumentParser(prog="campaigns", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    parser.add_argument("--share", type=float, default=1.0, help="of the cases to play [1]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=num_cores())
    options = parser.parse_args()
    unknown = set(options.names) - set(known)
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))} (known: {', '.join(known)})")
    chosen = [known[name] for name in options.names or known]
    tallies = play_all(chosen, options.share, options.seed, options.jobs)
    table = Table("campaign", "cases", "outcomes", "faults", "seconds")
    for name, tally in tallies.items():
        outcomes = ", ".join(f"{count:,} {what}" for what, count in tally.outcomes.most_common())
        row = (name, f"{tally.cases:,}", outcomes, str(len(tally.faults)), f"{tally.seconds:.0f}")
        table.add_row(*row)
    console = Console(width=120, highlight=False, markup=False)
    console.print(table)
    for name, tally in tallies.items():
        for fault in tally.faults[:50]:
            console.print(f"{name}: {fault}", soft_wrap=True)
    return 1 if any(tally.faults for tally in tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
