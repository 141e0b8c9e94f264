"""Recordings of a rig: reading a campaign folder, checking what is in it, and writing one.

campaign = read_campaign("campaigns/sandstone-2")
for finding in check_quality(campaign):
    print(finding)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drillenv.lazy import lazy

if TYPE_CHECKING:
    from drillenv.recordings.campaign import Campaign as Campaign
    from drillenv.recordings.campaign import Channel as Channel
    from drillenv.recordings.campaign import Recording as Recording
    from drillenv.recordings.campaign import read_campaign as read_campaign
    from drillenv.recordings.document import Nominal as Nominal
    from drillenv.recordings.findings import QualityFinding as QualityFinding
    from drillenv.recordings.quality import check_quality as check_quality
    from drillenv.recordings.write import write_campaign as write_campaign

__all__ = [
    "Campaign",
    "Channel",
    "Nominal",
    "QualityFinding",
    "Recording",
    "check_quality",
    "read_campaign",
    "write_campaign",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Campaign": "campaign",
        "Channel": "campaign",
        "Nominal": "document",
        "QualityFinding": "findings",
        "Recording": "campaign",
        "check_quality": "quality",
        "read_campaign": "campaign",
        "write_campaign": "write",
    },
)
