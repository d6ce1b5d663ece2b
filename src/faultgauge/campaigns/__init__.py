"""Campaigns: many simulated runs with faults in them, and what a calibrated model makes of them."""

from faultgauge.campaigns.carry_out import carry_out
from faultgauge.campaigns.result import Campaign
from faultgauge.campaigns.schema import Plan, read_campaign

__all__ = ["Campaign", "Plan", "carry_out", "read_campaign"]
