"""Files of other programs: ROS bags, workbooks, and tables of instruments and controllers that become recordings."""
