"""`python -m iout_marl` is `iout`."""

from iout_marl.cli import main

main()
