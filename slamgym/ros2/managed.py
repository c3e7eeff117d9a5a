"""Nodes that a lifecycle manager may configure, activate and deactivate, as Nav2's and slam_toolbox are."""

from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from slamgym.core.config import Arguments
from slamgym.ros2.node import RosNode


class ManagedNode(LifecycleNodeMixin, RosNode):
    """A node that begins active, or, with the parameter ``autostart`` false, once it is told to.

    Args:
        name: Of the node.
        parameters: What the command line says.

    Attributes:
        is_active: It takes what comes and publishes; else it stays as it is.
    """

    def __init__(self, name: str, parameters: Arguments) -> None:
        RosNode.__init__(self, name, parameters)
        LifecycleNodeMixin.__init__(self)
        self.is_active = False

    def begin_life(self) -> None:
        """Become active now, unless somebody else is to say when; called at the end of the construction."""
        if self.get_parameter("autostart").value:
            self.trigger_configure()
            self.trigger_activate()
        else:
            self.get_logger().info("waiting to be configured and activated")

    def destroy_node(self) -> None:
        """End the node; its states, which rclpy keeps, would hold its place on the network."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def wake(self) -> None:
        """Begin, or go on."""

    def sleep(self) -> None:
        """Stop at once; what there is stays."""

    def forget(self) -> None:
        """Let go of what there is; the next activation begins anew."""

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Wake; called by rclpy."""
        self.is_active = True
        self.wake()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Sleep; called by rclpy."""
        self.is_active = False
        self.sleep()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Forget; called by rclpy."""
        self.forget()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """End the node; called by rclpy."""
        self.is_active = False
        self.sleep()
        self.worker.end()
        return TransitionCallbackReturn.SUCCESS
