// Shows a face of fapengine on a model in Unreal: fapengine serve --sink ws-json://127.0.0.1:9200
//
// 1. Tools > New C++ Class > Actor Component, named FapengineFace. Replace its files with this one and FapengineFace.cpp.
//    If other modules use your module's classes, write its YOURGAME_API before UFapengineFace.
// 2. In YourGame.Build.cs: PublicDependencyModuleNames.AddRange(new[] { "WebSockets", "Json" }); then build.
// 3. Add the component to the actor whose skeletal mesh has the morph targets. Address is the server's; Visemes uses
//    the 15 of Oculus.
// 4. The head: in the Animation Blueprint a Transform (Modify) Bone node with the component's Head as its rotation. Bones
//    have their own axes; swap them until a nod is a nod.
#pragma once

#include "CoreMinimal.h"
#include "Components/ActorComponent.h"
#include "Components/SkeletalMeshComponent.h"
#include "Dom/JsonObject.h"
#include "IWebSocket.h"
#include "FapengineFace.generated.h"

UCLASS(ClassGroup = (Animation), meta = (BlueprintSpawnableComponent))
class UFapengineFace : public UActorComponent
{
    GENERATED_BODY()

public:
    UFapengineFace() { PrimaryComponentTick.bCanEverTick = true; }

    UPROPERTY(EditAnywhere) FString Address = TEXT("ws://127.0.0.1:9200/");
    // For models with the 15 visemes of Oculus instead of ARKit's shapes.
    UPROPERTY(EditAnywhere) bool bVisemes = false;
    // Degrees, for a Transform (Modify) Bone node of the head's Animation Blueprint.
    UPROPERTY(BlueprintReadOnly, Category = "Face") FRotator Head = FRotator::ZeroRotator;

    virtual void BeginPlay() override;
    virtual void EndPlay(const EEndPlayReason::Type Reason) override;
    virtual void TickComponent(float Seconds, ELevelTick Type, FActorComponentTickFunction* Function) override;

private:
    void Connect();
    void Show(const FJsonObject& Frame);
    void Rest();
    static FString Key(const FString& Name);

    TSharedPtr<IWebSocket> Socket;
    USkeletalMeshComponent* Face = nullptr;
    TMap<FString, FName> Shapes;  // spelling without case and marks: name of the morph target
    FString Newest;
    bool bLost = false;
    float WaitSeconds = 0.f;
};
