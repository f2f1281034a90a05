"""All solutions of the inverse kinematics of arms with six joints."""
