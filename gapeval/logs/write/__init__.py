"""Logs written: clouds, planar scans and transforms as ROS 1 bag, ROS 2 bag or MCAP."""

from gapeval.logs.write.log import CONTAINERS, log_path, write_log
from gapeval.logs.write.message import Cloud, Link, Links, Message, Scan

__all__ = ["CONTAINERS", "Cloud", "Link", "Links", "Message", "Scan", "log_path", "write_log"]
