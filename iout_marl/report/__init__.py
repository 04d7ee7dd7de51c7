"""Reports of studies: pages, figures and Markdown."""

from iout_marl.extras import require

require("iout_marl.report", "report")
