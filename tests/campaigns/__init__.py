"""Campaigns: bad input and bad moments by the thousand.

`make campaigns` runs all of them in full and prints what came of it; `tests/test_campaigns.py`
runs a few cases of each. A campaign is a module here that has `CAMPAIGN`.
"""
