extends SceneTree
# Shows a head with weights of shapes, given as JSON lines, in Godot 3; prints the weights that the meshes have then.

func find(node, kind, found):
	if node.is_class(kind):
		found.append(node)
	for child in node.get_children():
		find(child, kind, found)
	return found

func _init():
	var head = load("res://head.glb").instance()
	root.add_child(head)
	var meshes = find(head, "MeshInstance", [])
	var skeleton = find(head, "Skeleton", [])[0]
	print("joints ", skeleton.get_bone_count())
	for mesh in meshes:
		var material = mesh.mesh.surface_get_material(0)
		material.vertex_color_use_as_albedo = true
	var camera = Camera.new()
	root.add_child(camera)
	camera.fov = 30
	var eyes = Vector3(0, 1.62, 0.08)
	camera.look_at_from_position(eyes + Vector3(0.1, -0.04, 0.72), eyes + Vector3(0, -0.04, 0), Vector3.UP)
	camera.current = true
	var light = DirectionalLight.new()
	root.add_child(light)
	light.light_energy = 0.7
	light.look_at_from_position(Vector3(0.5, 3, 2), Vector3(0, 1.5, 0), Vector3.UP)
	var world = WorldEnvironment.new()
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_COLOR
	world.environment.background_color = Color("dfe6ea")
	world.environment.ambient_light_color = Color(1, 1, 1)
	world.environment.ambient_light_energy = 0.4
	root.add_child(world)
	var poses = File.new()
	poses.open("res://poses.json", File.READ)
	for pose in JSON.parse(poses.get_as_text()).result:
		for mesh in meshes:
			for name in pose.weights:
				if mesh.get("blend_shapes/" + name) != null:
					mesh.set("blend_shapes/" + name, pose.weights[name])
		for frame in range(3):
			yield(self, "idle_frame")
		yield(VisualServer, "frame_post_draw")
		var picture = root.get_texture().get_data()
		picture.flip_y()
		picture.save_png("res://" + pose.name + ".png")
		for mesh in meshes:
			if mesh.name == "Face":
				print("jawOpen ", mesh.get("blend_shapes/jawOpen"))
	quit()
